use super::*;

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
}

#[test]
fn columns_are_found_by_their_names_or_taken_in_order() {
    let by_name = cloud_from_bytes(b"\xef\xbb\xbf# a comment\nt;Z_mm;\"x\";y\n0;3;1;2\n").unwrap();
    assert_eq!(by_name.points, vec![Vec3::new(1.0, 2.0, 3.0)]);
    let in_order = cloud_from_bytes(b"1 2 3 255 0 0\n4\t5\t6\n").unwrap();
    assert_eq!(in_order.points.len(), 2);
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

#[test]
fn what_is_written_is_read_back() {
    let mut bytes = Vec::new();
    write_ply(&mut bytes, &points(), Some(("stock", &[0.1, 0.2, 0.3]))).unwrap();
    assert_eq!(cloud_from_bytes(&bytes).unwrap().points, points());
}
