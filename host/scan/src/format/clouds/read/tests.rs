use super::cloud_from_bytes;
use crate::format::clouds::write_ply;
use crate::rigid::Vec3;

fn points() -> Vec<Vec3> {
    vec![
        Vec3::new(1.0, 2.5, -3.0),
        Vec3::new(300_000.125, -0.5, 0.25),
        Vec3::new(0.0, 0.0, 0.0),
    ]
}

fn head(format: &str, n: usize, kind: &str) -> Vec<u8> {
    format!(
        "ply\nformat {format} 1.0\ncomment a scan\nelement sensor 2\nproperty list uchar short a\nproperty float b\nelement vertex {n}\nproperty uchar red\nproperty {kind} z\nproperty {kind} y\nproperty {kind} x\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes()
}

#[test]
fn every_kind_of_ply_gives_the_same_points() {
    for (kind, big) in [
        ("float", false),
        ("double", false),
        ("float32", true),
        ("float64", true),
    ] {
        let format = if big {
            "binary_big_endian"
        } else {
            "binary_little_endian"
        };
        let mut bytes = head(format, 3, kind);
        let mut put = |raw: &mut Vec<u8>| {
            if big {
                raw.reverse();
            }
            bytes.append(raw);
        };
        for n in [0_u8, 2] {
            put(&mut vec![n]);
            for k in 0..n {
                put(&mut i16::from(k).to_le_bytes().to_vec());
            }
            put(&mut 1_f32.to_le_bytes().to_vec());
        }
        for p in points() {
            put(&mut vec![200]);
            for x in [p.z, p.y, p.x] {
                if kind.ends_with("64") || kind == "double" {
                    put(&mut x.to_le_bytes().to_vec());
                } else {
                    put(&mut (x as f32).to_le_bytes().to_vec());
                }
            }
        }
        let cloud = cloud_from_bytes(&bytes).unwrap();
        assert_eq!(cloud.points, points(), "{kind} {format}");
    }
    let mut text = head("ascii", 3, "float");
    text.extend(b"0 1.5\n2 7 8 1.5\n9 -3 2.5 1\n9 0.25 -0.5 300000.125\r\n\n9 0 0 0\n0\n");
    assert_eq!(cloud_from_bytes(&text).unwrap().points, points());
}

#[test]
fn what_is_not_finite_is_dropped_and_counted() {
    let cloud = cloud_from_bytes(b"x,y,z\n1,2,3\nnan,0,0\n1,inf,2\n4,5,6\n").unwrap();
    assert_eq!((cloud.points.len(), cloud.not_finite), (2, 2));
    // In STL the other corners of such a triangle are points as well.
    let facet = |corner: &str| {
        format!(
            "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex {corner}\nendloop\nendfacet\n"
        )
    };
    let stl = format!(
        "solid a\n{}{}endsolid a\n",
        facet("0 1 0"),
        facet("nan 5 0")
    );
    let cloud = cloud_from_bytes(stl.as_bytes()).unwrap();
    assert_eq!((cloud.points.len(), cloud.not_finite), (3, 1));
}

#[test]
fn columns_are_found_by_their_names_or_taken_in_order() {
    let by_name = cloud_from_bytes(b"\xef\xbb\xbf# a comment\nt;Z_mm;\"x\";y\n0;3;1;2\n").unwrap();
    assert_eq!(by_name.points, vec![Vec3::new(1.0, 2.0, 3.0)]);
    let in_order = cloud_from_bytes(b"1 2 3 255 0 0\n4  5\t6 0 0 0 \n").unwrap();
    assert_eq!(in_order.points.len(), 2);
}

/// A PCD header with a column before, between and behind.
fn pcd(points: usize, data: &str) -> Vec<u8> {
    format!(
        "# .PCD v0.7 - a scan\nVERSION 0.7\nFIELDS rgb x normal y z\nSIZE 4 8 4 8 8\nTYPE U F F F F\nCOUNT 1 1 3 1 1\nWIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    )
    .into_bytes()
}

#[test]
fn every_kind_of_pcd_gives_the_same_points() {
    let mut text = pcd(3, "ascii");
    text.extend(b"7 1 0 0 1 2.5 -3\r\n7 300000.125 0 0 1 -0.5 0.25\n\n7 0 0 0 1 0 0\n");
    assert_eq!(cloud_from_bytes(&text).unwrap().points, points());
    let mut binary = pcd(3, "binary");
    let mut columns: [Vec<u8>; 5] = Default::default();
    for p in points() {
        let record = [
            vec![9; 4],
            p.x.to_le_bytes().to_vec(),
            vec![1; 12],
            p.y.to_le_bytes().to_vec(),
            p.z.to_le_bytes().to_vec(),
        ];
        binary.extend(record.concat());
        for (column, bytes) in columns.iter_mut().zip(record) {
            column.extend(bytes);
        }
    }
    assert_eq!(cloud_from_bytes(&binary).unwrap().points, points());
    // Twelve times 9 as one 9 and a reference to it, 36 times 1 with a long one; all else as it is.
    let whole = columns.concat();
    let mut packed = vec![0, 9, (7 << 5), 2, 0];
    let mut at = 12;
    for run in [24_usize, 0, 24, 24] {
        if run == 0 {
            packed.extend([0, 1, (7 << 5), 26, 0]);
            at += 36;
        } else {
            packed.push(run as u8 - 1);
            packed.extend(&whole[at..at + run]);
            at += run;
        }
    }
    assert_eq!(at, whole.len());
    let compressed = |packed: &[u8]| {
        let mut file = pcd(3, "binary_compressed");
        file.extend((packed.len() as u32).to_le_bytes());
        file.extend((whole.len() as u32).to_le_bytes());
        file.extend(packed);
        cloud_from_bytes(&file)
    };
    assert_eq!(compressed(&packed).unwrap().points, points());
    // Whatever byte is damaged: an answer or a refusal, and no panic.
    for i in 0..packed.len() {
        for value in [0, 31, 32, 224, 255] {
            let mut damaged = packed.clone();
            damaged[i] = value;
            let _ = compressed(&damaged);
            let _ = compressed(&damaged[..i]);
        }
    }
}

#[test]
fn a_las_file_has_its_scale_and_offset() {
    let mut file = vec![0; 227];
    file[..4].copy_from_slice(b"LASF");
    file[24..26].copy_from_slice(&[1, 2]);
    file[94..96].copy_from_slice(&227_u16.to_le_bytes());
    file[96..100].copy_from_slice(&227_u32.to_le_bytes());
    file[105..107].copy_from_slice(&20_u16.to_le_bytes());
    file[107..111].copy_from_slice(&2_u32.to_le_bytes());
    for (i, (scale, offset)) in [(0.5, 100.0), (0.25, 0.0), (1.0, -3.0)].iter().enumerate() {
        file[131 + 8 * i..139 + 8 * i].copy_from_slice(&f64::to_le_bytes(*scale));
        file[155 + 8 * i..163 + 8 * i].copy_from_slice(&f64::to_le_bytes(*offset));
    }
    for point in [[2_i32, -4, 7], [0, 0, i32::MIN]] {
        file.extend(point.iter().flat_map(|x| x.to_le_bytes()));
        file.extend([0; 8]);
    }
    let cloud = cloud_from_bytes(&file).unwrap();
    assert_eq!(cloud.points[0], Vec3::new(101.0, -1.0, 4.0));
    assert_eq!(cloud.points[1].z, -2_147_483_651.0);
    let code = |bytes: &[u8]| cloud_from_bytes(bytes).map_err(|refusal| refusal.code);
    for cut in [10, 226, 260, file.len() - 1] {
        assert_eq!(code(&file[..cut]), Err("bad_file"), "{cut}");
    }
    for (at, value) in [(110, 0xff), (104, 0x80), (105, 12), (99, 0xff), (96, 0)] {
        let mut damaged = file.clone();
        damaged[at] = value;
        assert_eq!(code(&damaged), Err("bad_file"), "{at}");
    }
}

#[test]
fn the_corners_of_a_scan_in_triangles_count_once() {
    let text = b"solid scan\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nfacet normal 0 0 1\nouter loop\nvertex 1 0 -0\nvertex 1 1 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid scan\n";
    assert_eq!(cloud_from_bytes(text).unwrap().points.len(), 4);
    let mut binary = vec![b' '; 80];
    binary.extend(1_u32.to_le_bytes());
    binary.extend([0; 12]);
    binary.extend(
        [0.0_f32, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 5.0, 0.0]
            .map(f32::to_le_bytes)
            .concat(),
    );
    binary.extend([0; 2]);
    assert_eq!(cloud_from_bytes(&binary).unwrap().points.len(), 3);
    for cut in [&text[..60], b"ASTM-E57 and more"] {
        let code = cloud_from_bytes(cut).map_err(|refusal| refusal.code);
        assert_eq!(code, Err("bad_file"));
    }
}

#[test]
fn a_pcd_file_is_refused_before_memory_is_taken() {
    let code = |bytes: &[u8]| cloud_from_bytes(bytes).map_err(|refusal| refusal.code);
    for data in ["ascii", "binary", "binary_compressed", "odd"] {
        for points in [1, 4_000_000_000, usize::MAX / 30, usize::MAX] {
            let mut file = pcd(points, data);
            assert_eq!(code(&file), Err("bad_file"), "{points} {data}");
            // A stated size that is as large as the points, packed into nothing.
            file.extend([4, 0, 0, 0, 0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0]);
            assert_eq!(code(&file), Err("bad_file"), "{points} {data}");
        }
    }
    let whole = String::from_utf8(pcd(0, "ascii")).unwrap();
    for (from, to) in [
        ("FIELDS rgb x", "FIELDS rgb w"),
        ("SIZE 4 8", "SIZE 4 3"),
        ("COUNT 1 1 3", "COUNT 1 1"),
        ("DATA", "DUTY"),
    ] {
        assert_eq!(
            code(whole.replace(from, to).as_bytes()),
            Err("bad_file"),
            "{from}"
        );
    }
    let huge = whole.replace("COUNT 1 1 3", "COUNT 1 1 18446744073709551615");
    assert_eq!(code(huge.as_bytes()), Err("bad_file"));
}

#[test]
fn a_bad_file_is_refused_before_memory_is_taken() {
    let code = |bytes: &[u8]| cloud_from_bytes(bytes).map_err(|refusal| refusal.code);
    let head = |count: &str| {
        format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\nend_header\n").into_bytes()
    };
    for count in [
        "1",
        "4000000000",
        "18446744073709551615",
        "1537228672809129302",
        "-1",
    ] {
        assert_eq!(code(&head(count)), Err("bad_file"), "{count}");
    }
    let text = String::from_utf8(head("99999999999"))
        .unwrap()
        .replace("binary_little_endian", "ascii");
    assert_eq!(code(text.as_bytes()), Err("bad_file"));
    for bytes in [
        b"".as_slice(),
        b"ply\n",
        b"ply\nformat ascii 1.0\nend_header\n",
        b"x,y\n1,2\n",
        b"x,y,z\n1,2\n",
        b"\xff\xfe\x00",
    ] {
        assert_eq!(code(bytes), Err("bad_file"), "{bytes:?}");
    }
}

/// Tables as other programs name their columns: in mm by the unit that the names say, and refused where they may mean two things.
#[test]
fn a_unit_in_the_names_of_columns_is_followed() {
    let read = |text: &str| cloud_from_bytes(text.as_bytes());
    for (names, mm) in [
        ("X [mm],Y [mm],Z [mm]", 1.0),
        ("X(mm),Y(mm),Z(mm)", 1.0),
        ("x_mm,y_mm,z_mm", 1.0),
        ("\"X/mm\",\"Y/mm\",\"Z/mm\"", 1.0),
        ("X-Koordinate [mm],Y-Koordinate [mm],Z-Koordinate [mm]", 1.0),
        ("Position X (mm),Position Y (mm),Position Z (mm)", 1.0),
        ("x_m,y_m,z_m", 1000.0),
        ("X [inch],Y [in],Z [inches]", 25.4),
        ("X [\u{b5}m],Y [\u{b5}m],Z [um]", 1e-3),
    ] {
        let cloud = read(&format!("{names}\n1,2,-3\n")).unwrap();
        assert_eq!(cloud.points, [Vec3::new(1.0, 2.0, -3.0) * mm], "{names}");
        assert_eq!(
            (cloud.states_unit, cloud.unit_mm),
            (true, Some(mm)),
            "{names}"
        );
    }
    for names in ["x,y,z", "//X,Y,Z", "X-Koordinate,Y-Koordinate,Z-Koordinate"] {
        let cloud = read(&format!("{names}\n1,2,-3\n")).unwrap();
        assert_eq!(
            (cloud.points[0].z, cloud.states_unit),
            (-3.0, false),
            "{names}"
        );
    }
    let german = read("X [mm];Y [mm];Z [mm];Wert\n1,5;2;-3,25;0,1\n").unwrap();
    assert_eq!(german.points, [Vec3::new(1.5, 2.0, -3.25)]);
    for (names, told) in [
        ("X [ft],Y [ft],Z [ft]", "is in \"ft\""),
        ("X [m],Y,Z", "some of the columns"),
        ("X [mm],X [inch],Z [mm]", "may both be x"),
        ("u,v,w", "there is no column \"x_mm\""),
    ] {
        let error = read(&format!("{names}\n1,2,-3\n")).unwrap_err();
        assert_eq!(error.code, "bad_file");
        assert!(error.message.contains(told), "{error}");
    }
}

/// A scan in STL that is cut, or that has no triangle with an area, is told as what it is.
#[test]
fn an_stl_file_that_is_no_scan_is_told_as_one() {
    use crate::format::clouds::read::{CloudReader, read_cloud};
    let folder = std::env::temp_dir().join(format!("umi-stl-scan-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("scan.stl");
    let file = |corners: [[f32; 3]; 3], count: u32| {
        let numbers = [[0.0; 3]].into_iter().chain(corners).flatten();
        let record: Vec<u8> = numbers.flat_map(f32::to_le_bytes).chain([0, 0]).collect();
        let records = record.repeat(3);
        [&[b' '; 80][..], &count.to_le_bytes(), &records].concat()
    };
    let (whole, point) = (
        [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        [[1.0, 2.0, 3.0]; 3],
    );
    for (bytes, told) in [
        (file(whole, 9), "the header states 9 triangles"),
        (file(point, 3), "no triangle of this STL file has an area"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let error = read_cloud(&path).unwrap_err();
        assert_eq!(error.code, "bad_file");
        assert!(error.message.contains(told), "{error}");
        let opened = CloudReader::open(&path).map(|_| ()).unwrap_err();
        assert_eq!(opened, error);
    }
    std::fs::write(&path, file(whole, 3)).unwrap();
    assert_eq!(read_cloud(&path).unwrap().points.len(), 3);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn what_is_written_is_read_back() {
    let mut bytes = Vec::new();
    write_ply(&mut bytes, &points(), &[("stock", &[0.1, 0.2, 0.3])]).unwrap();
    assert_eq!(cloud_from_bytes(&bytes).unwrap().points, points());
}

/// Damaged files of formats that others read: a name, never the end of the program, never memory on a header's word.
#[cfg(feature = "cloud-formats")]
#[test]
fn damage_in_the_files_of_others_is_named() {
    use crate::cloud::CloudPoint;
    use crate::format::clouds::{CloudStyle, write_cloud};
    let folder = std::env::temp_dir().join(format!("umi-foreign-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let point = |k: u32| CloudPoint {
        at: [f64::from(k), 0.5, -1.25],
        ..CloudPoint::default()
    };
    let mut refused = 0;
    for name in ["a.laz", "a.e57"] {
        let path = folder.join(name);
        let points = (0..40).map(|k| Ok(point(k)));
        write_cloud(&path, CloudStyle::default(), Box::new(points)).unwrap();
        let whole = std::fs::read(&path).unwrap();
        assert_eq!(cloud_from_bytes(&whole).unwrap().points.len(), 40);
        let mut seed = 5_u64;
        for _ in 0..400 {
            let mut bytes = whole.clone();
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            let at = (seed >> 33) as usize % bytes.len();
            bytes[at] ^= (seed >> 24) as u8 | 1;
            if seed.is_multiple_of(4) {
                bytes.truncate(at);
            }
            match cloud_from_bytes(&bytes) {
                Ok(cloud) => assert!(cloud.points.len() + cloud.not_finite < 100_000),
                Err(refusal) => {
                    assert_eq!(refusal.code, "bad_file");
                    refused += 1;
                }
            }
        }
    }
    assert!(refused > 300, "{refused}");
    std::fs::remove_dir_all(folder).unwrap();
}
