//! What is written is read by others: our own reader where there is one, else a look at the bytes, or another crate's reader.

use std::path::PathBuf;

use super::{CloudReader, CloudStyle, write_cloud};
use crate::ScanError;
use crate::cloud::{CloudColumns, CloudPoint};

/// A folder of this test's own.
fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("umi-clouds-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn cloud() -> Vec<CloudPoint> {
    (0..5000_u32)
        .map(|i| CloudPoint {
            at: [
                800.0 + f64::from(i) * 0.0125,
                -f64::from(i % 97) * 0.4375,
                f64::from(i % 13) * 0.25 - 1.5,
            ],
            profile: u64::from(i / 100),
            index: i % 100,
            t_us: 1e9 / 3.0 + f64::from(i / 100) * 250.125,
            intensity: f64::from(i % 256),
            // A float keeps it.
            mount_u_mm: f64::from(i % 31) / 1024.0,
            interpolated: i / 100 % 7 == 3,
        })
        .collect()
}

const ALL: CloudColumns = CloudColumns {
    profile: true,
    index: true,
    time: true,
    intensity: true,
    mount_u: true,
    interpolated: true,
};

fn write(path: &std::path::Path, double: bool) -> u64 {
    let style = CloudStyle {
        columns: ALL,
        double,
        longest_mm: None,
    };
    write_cloud(path, style, Box::new(cloud().into_iter().map(Ok)))
        .unwrap()
        .points
}

fn near(a: [f64; 3], b: [f64; 3], within: f64) {
    for (a, b) in a.iter().zip(b) {
        assert!((a - b).abs() <= within, "{a} {b}");
    }
}

#[test]
fn tables_and_ply_come_back_as_they_were() {
    let folder = folder("own");
    for (name, double) in [("a.csv", false), ("a.ply", true)] {
        let path = folder.join(name);
        assert_eq!(write(&path, double), 5000);
        let mut reader = CloudReader::open(&path).unwrap();
        assert_eq!(reader.columns, ALL);
        for wanted in cloud() {
            assert_eq!(reader.next_point().unwrap(), Some(wanted));
        }
        assert_eq!(reader.next_point().unwrap(), None);
        // The other reader of the house, which holds the whole cloud.
        assert_eq!(
            crate::format::clouds::read_cloud(&path)
                .unwrap()
                .points
                .len(),
            5000
        );
    }
    let path = folder.join("f.ply");
    write(&path, false);
    let mut reader = CloudReader::open(&path).unwrap();
    for wanted in cloud() {
        near(reader.next_point().unwrap().unwrap().at, wanted.at, 3e-5);
    }
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn coordinates_of_other_formats_come_back() {
    let folder = folder("whole");
    for name in ["a.pcd", "a.las", "a.laz", "a.e57"] {
        if cfg!(not(feature = "cloud-formats")) && name != "a.pcd" {
            continue;
        }
        let path = folder.join(name);
        write(&path, true);
        let mut reader = CloudReader::open(&path).unwrap();
        let holds_all = ["a.pcd", "a.e57"].contains(&name);
        let columns = CloudColumns {
            profile: holds_all,
            index: holds_all,
            time: true,
            intensity: true,
            mount_u: name == "a.pcd",
            // E57 has no room for it.
            interpolated: name != "a.e57",
        };
        assert_eq!(reader.columns, columns, "{name}");
        for wanted in cloud() {
            let found = reader.next_point().unwrap().unwrap();
            assert!((found.t_us - wanted.t_us).abs() < 1e-6, "{name}");
            // A step of LAS is 0.1 µm.
            near(found.at, wanted.at, 5.1e-5);
            if holds_all {
                assert_eq!((found.profile, found.index), (wanted.profile, wanted.index));
            }
            assert_eq!(
                found.interpolated,
                columns.interpolated && wanted.interpolated,
                "{name}"
            );
            let u_mm = if columns.mount_u {
                wanted.mount_u_mm
            } else {
                0.0
            };
            assert_eq!(found.mount_u_mm, u_mm, "{name}");
            let within = if holds_all { 1e-3 } else { 0.5 };
            assert!(
                (found.intensity - wanted.intensity).abs() <= within,
                "{name}"
            );
        }
        assert_eq!(reader.next_point().unwrap(), None);
    }
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn pcd_has_its_header_and_records() {
    let folder = folder("pcd");
    let path = folder.join("a.pcd");
    write(&path, true);
    let bytes = std::fs::read(&path).unwrap();
    let end = bytes
        .windows(12)
        .position(|w| w == b"DATA binary\n")
        .unwrap()
        + 12;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let value = |name: &str| {
        let line = header.lines().find(|l| l.starts_with(name)).unwrap();
        line[name.len()..].trim().to_owned()
    };
    assert_eq!(
        value("FIELDS"),
        "x y z profile index t_us intensity mount_u_mm interpolated"
    );
    assert_eq!(value("SIZE"), "8 8 8 4 4 8 4 4 1");
    assert_eq!(value("TYPE"), "F F F U U F F F U");
    assert_eq!(
        (value("WIDTH"), value("POINTS")),
        ("5000".into(), "5000".into())
    );
    let stride = 49;
    assert_eq!(bytes.len() - end, 5000 * stride);
    for (record, wanted) in bytes[end..].chunks_exact(stride).zip(cloud()) {
        let real = |k: usize| f64::from_le_bytes(record[8 * k..8 * k + 8].try_into().unwrap());
        assert_eq!([real(0), real(1), real(2)], wanted.at);
        let whole = |at: usize| u32::from_le_bytes(record[at..at + 4].try_into().unwrap());
        assert_eq!(
            (u64::from(whole(24)), whole(28)),
            (wanted.profile, wanted.index)
        );
        assert_eq!(record[48], u8::from(wanted.interpolated));
    }
    std::fs::remove_dir_all(folder).unwrap();
}

/// LAS by the places that its specification states, and LAZ by the crate's reader, which must say the same.
#[cfg(feature = "cloud-formats")]
#[test]
fn las_and_laz_hold_tenths_of_micrometres() {
    let folder = folder("las");
    write(&folder.join("a.las"), false);
    write(&folder.join("a.laz"), false);
    let bytes = std::fs::read(folder.join("a.las")).unwrap();
    assert_eq!(&bytes[..4], b"LASF");
    let u16_at = |at: usize| u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap());
    let u32_at = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let f64_at = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    let (begin, stride) = (u32_at(96) as usize, usize::from(u16_at(105)));
    assert_eq!((u32_at(107), bytes.len()), (5000, begin + 5000 * stride));
    for (k, wanted) in cloud().iter().enumerate() {
        let record = begin + k * stride;
        let at = [0, 1, 2].map(|axis| {
            let steps = u32_at(record + 4 * axis).cast_signed();
            f64::from(steps) * f64_at(131 + 8 * axis) + f64_at(155 + 8 * axis)
        });
        near(at, wanted.at, 0.51e-4);
        assert_eq!(f64::from(u16_at(record + 12)), wanted.intensity);
        // Bit 5 beside the classification: synthetic.
        assert_eq!(bytes[record + 15] == 0b0010_0000, wanted.interpolated);
    }
    // The header says what the points span.
    near(
        [f64_at(179), f64_at(195), f64_at(211)],
        [800.0 + 4999.0 * 0.0125, 0.0, 1.5],
        1e-4,
    );
    let mut reader = las::Reader::from_path(folder.join("a.laz")).unwrap();
    let points = reader.read_all().unwrap();
    let mut n = 0;
    for (point, wanted) in points.points().zip(cloud()) {
        let point = point.unwrap();
        near([point.x, point.y, point.z], wanted.at, 0.51e-4);
        n += 1;
    }
    assert_eq!(n, 5000);
    // What the steps cannot reach is refused, and nothing is left.
    let far = [[0.0; 3], [3e5, 0.0, 0.0]].map(|at| {
        Ok(CloudPoint {
            at,
            ..CloudPoint::default()
        })
    });
    let path = folder.join("far.las");
    let refused = write_cloud(&path, CloudStyle::default(), Box::new(far.into_iter())).unwrap_err();
    assert!(refused.message.contains("200 m"), "{}", refused.message);
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 2);
    std::fs::remove_dir_all(folder).unwrap();
}

#[cfg(feature = "cloud-formats")]
#[test]
fn e57_has_metres_rows_and_columns() {
    use e57::{CartesianCoordinate, E57Reader};
    let folder = folder("e57");
    let path = folder.join("a.e57");
    write(&path, false);
    let file = std::fs::File::open(&path).unwrap();
    E57Reader::validate_crc(std::io::BufReader::new(file)).unwrap();
    let mut reader = E57Reader::from_file(&path).unwrap();
    let clouds = reader.pointclouds();
    assert_eq!((clouds.len(), clouds[0].records), (1, 5000));
    let points: Vec<_> = reader
        .pointcloud_simple(&clouds[0])
        .unwrap()
        .map(Result::unwrap)
        .collect();
    assert_eq!(points.len(), 5000);
    for (point, wanted) in points.iter().zip(cloud()) {
        let CartesianCoordinate::Valid { x, y, z } = point.cartesian else {
            panic!("no coordinates");
        };
        near([x * 1e3, y * 1e3, z * 1e3], wanted.at, 1e-9);
        assert_eq!(
            (point.row, point.column),
            (wanted.profile as i64, i64::from(wanted.index))
        );
    }
    std::fs::remove_dir_all(folder).unwrap();
}

#[cfg(feature = "cloud-formats")]
#[test]
fn parquet_has_a_column_for_each() {
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::RowAccessor;
    let folder = folder("parquet");
    let path = folder.join("a.parquet");
    write(&path, false);
    let reader = SerializedFileReader::new(std::fs::File::open(&path).unwrap()).unwrap();
    assert_eq!(reader.metadata().file_metadata().num_rows(), 5000);
    let mut n = 0;
    for (row, wanted) in reader.get_row_iter(None).unwrap().zip(cloud()) {
        let row = row.unwrap();
        assert_eq!(row.get_long(0).unwrap() as u64, wanted.profile);
        let at = [2, 3, 4].map(|k| row.get_double(k).unwrap());
        assert_eq!(
            (at, [5, 6].map(|k| row.get_double(k).unwrap())),
            (wanted.at, [wanted.t_us, wanted.intensity])
        );
        assert_eq!(row.get_bool(8).unwrap(), wanted.interpolated);
        n += 1;
    }
    assert_eq!(n, 5000);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn a_cloud_that_breaks_off_leaves_no_file() {
    let folder = folder("cut");
    let source = folder.join("a.ply");
    write(&source, true);
    let bytes = std::fs::read(&source).unwrap();
    let cut = folder.join("cut.ply");
    std::fs::write(&cut, &bytes[..bytes.len() - 7]).unwrap();
    for extension in ["csv", "ply", "pcd", "las", "laz", "e57", "parquet"] {
        if cfg!(not(feature = "cloud-formats")) && !["csv", "ply", "pcd"].contains(&extension) {
            continue;
        }
        let mut reader = CloudReader::open(&cut).unwrap();
        let points = std::iter::from_fn(move || reader.next_point().transpose());
        let to = folder.join(format!("to.{extension}"));
        let refused = write_cloud(&to, CloudStyle::default(), Box::new(points)).unwrap_err();
        assert_eq!(refused.code, "bad_file");
    }
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 2);
    let to = folder.join("to.xyz");
    let none = || Box::new(std::iter::empty::<Result<CloudPoint, ScanError>>());
    assert_eq!(
        write_cloud(&to, CloudStyle::default(), none())
            .unwrap_err()
            .code,
        "format"
    );
    std::fs::remove_dir_all(folder).unwrap();
}

/// Bytes turned into others in small clouds: an answer or a name, never a panic, never memory without end.
#[test]
fn damaged_clouds_are_named() {
    let folder = folder("damage");
    let path = folder.join("a.ply");
    let binary = {
        let style = CloudStyle {
            columns: ALL,
            double: false,
            longest_mm: None,
        };
        write_cloud(&path, style, Box::new(cloud().into_iter().take(9).map(Ok))).unwrap();
        std::fs::read(&path).unwrap()
    };
    let text = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty double z\nproperty uchar index\nend_header\n1 2 3 4\n5 6 7 8\n\n9 10 nan 12\n".to_vec();
    let table = b"profile,index,x_mm,y_mm,z_mm\n0,1,2.5,3,4\n0,2,5,6e2,7\n".to_vec();
    let mut seed = 99_u64;
    for original in [binary, text, table] {
        for _ in 0..400 {
            let mut bytes = original.clone();
            for _ in 0..=seed % 3 {
                seed = seed
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                let at = (seed >> 33) as usize % bytes.len();
                bytes[at] = (seed >> 24) as u8;
            }
            bytes.truncate(bytes.len() - (seed >> 50) as usize % 4);
            std::fs::write(&path, &bytes).unwrap();
            let mut taken = 0;
            let read = CloudReader::open(&path).and_then(|mut reader| {
                while reader.next_point()?.is_some() {
                    taken += 1;
                }
                Ok(())
            });
            assert!(taken < 1000);
            if let Err(error) = read {
                let known = ["bad_file", "corrupt", "truncated", "missing_column", "file"];
                assert!(known.contains(&error.code), "{}", error.code);
            }
        }
    }
    std::fs::remove_dir_all(folder).unwrap();
}

/// A profile or a place in it that is no whole number is no point's: it became another's before.
#[test]
fn a_profile_of_a_ply_is_a_whole_number() {
    let folder = folder("odd");
    let path = folder.join("odd.ply");
    for (profile, index, right) in [("3", "7", true), ("1.5", "7", false), ("3", "-2", false)] {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nproperty double y\nproperty double z\n\
             property float profile\nproperty float index\nend_header\n0 0 0 {profile} {index}\n"
        );
        std::fs::write(&path, text).unwrap();
        let point = CloudReader::open(&path).unwrap().next_point();
        assert_eq!(point.is_ok(), right, "{profile} {index}");
    }
    std::fs::remove_dir_all(folder).unwrap();
}
