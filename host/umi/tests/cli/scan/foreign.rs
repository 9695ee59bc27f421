//! What a merge writes by a crate is read back by another implementation: laspy, pye57 and pyarrow, which
//! `cargo xtask set-up` brings.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::rig::run::{Folder, project, umi};

/// Reads a file and prints a row a point: x y z in mm, the time in µs, the intensity; and what the format has of profile
/// and index, else -1.
const READ: &str = r#"
import sys
path = sys.argv[1]
kind = path.rsplit('.', 1)[1]
if kind in ('las', 'laz'):
    import laspy
    f = laspy.read(path)
    n = len(f.points)
    rows = zip(f.x, f.y, f.z, f.gps_time * 1e6, f.intensity, [-1] * n, [-1] * n)
elif kind == 'parquet':
    import pyarrow.parquet
    t = pyarrow.parquet.read_table(path)
    names = ('x_mm', 'y_mm', 'z_mm', 't_us', 'intensity', 'profile', 'index')
    rows = zip(*(t[name].to_pylist() for name in names))
else:
    import pye57
    f = pye57.E57(path)
    assert f.scan_count == 1
    names = ('cartesianX', 'cartesianY', 'cartesianZ')
    d = f.read_scan_raw(0, ignore_unsupported_fields=True)
    n = len(d['cartesianX'])
    rows = zip(*(d[name] * 1e3 for name in names), [-1] * n, d['intensity'], d['rowIndex'], d['columnIndex'])
for row in rows:
    print(*(repr(float(v)) for v in row))
"#;

/// The Python that has them; none where it is not there, which is an error where tests may not be left out.
fn python() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_TARGET_TMPDIR")).parent()?;
    let python = beside.join("xtask/readers/bin/python");
    if python.is_file() {
        return Some(python);
    }
    let in_ci = std::env::var_os("CI").is_some_and(|value| !value.is_empty() && value != "false");
    assert!(
        !in_ci,
        "{} is required here; `cargo xtask set-up` brings it",
        python.display()
    );
    // Not `eprintln!`: that is not shown for a test that passes.
    let _ = std::io::stderr()
        .write_all(b"skipped: no other readers of clouds; `cargo xtask set-up` brings them\n");
    None
}

/// The points of the crates' files are those of the table, point by point and in its order.
#[test]
fn others_read_what_is_written() {
    let Some(python) = python() else { return };
    let folder = Folder::new();
    let case = |name: &str| project(&format!("tests/reference/scan/merge_5axis_latency.{name}"));
    let plain = std::fs::read_to_string(case("profiles.csv")).unwrap();
    let bright = |row: usize| {
        if row == 0 {
            "intensity".into()
        } else {
            (row % 251).to_string()
        }
    };
    let beside = |(row, text): (usize, &str)| format!("{text},{}\n", bright(row));
    let profiles: String = plain.lines().enumerate().map(beside).collect();
    let profiles = folder.file("profiles.csv", profiles);
    let merge = |out: &str| {
        let args = ["scan", "merge", &profiles, &case("triggers.csv")];
        let more = ["--machine", &case("toml"), "-o", out, "--latency-us", "137"];
        let kept = ["--times-too", "--intensity-too", "--double"];
        umi(&[&args[..], &more, &kept].concat()).exits(0);
    };
    let table = folder.path("table.csv");
    merge(&table);
    let table = std::fs::read_to_string(&table).unwrap();
    let head = "profile,index,x_mm,y_mm,z_mm,t_us,intensity";
    assert_eq!(table.lines().next(), Some(head));
    let numbers = |row: &str, between: char| -> Vec<f64> {
        let cells = row.trim().split(between);
        cells.map(|cell| cell.parse().unwrap()).collect()
    };
    let wanted: Vec<Vec<f64>> = table.lines().skip(1).map(|row| numbers(row, ',')).collect();
    assert!(wanted.len() > 100);
    // Half a step of LAS is 0.05 µm; E57 has metres, where a double of 1 m is right to 0.2 nm; Parquet has the doubles.
    for (kind, within_mm) in [
        ("las", 5.1e-5),
        ("laz", 5.1e-5),
        ("e57", 1e-9),
        ("parquet", 0.0),
    ] {
        let cloud = folder.path(&format!("cloud.{kind}"));
        merge(&cloud);
        let ran = Command::new(&python)
            .args(["-c", READ, &cloud])
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.success(), "{kind}: {said}");
        let text = String::from_utf8(ran.stdout).unwrap();
        let found: Vec<Vec<f64>> = text.lines().map(|row| numbers(row, ' ')).collect();
        assert_eq!(found.len(), wanted.len(), "{kind}");
        for (found, wanted) in found.iter().zip(&wanted) {
            for k in 0..3 {
                let off = (found[k] - wanted[2 + k]).abs();
                assert!(off <= within_mm, "{kind}: {found:?} {wanted:?}");
            }
            // pye57 reads no times; LAS has no room for profile and index.
            let time = kind == "e57" || (found[3] - wanted[5]).abs() < 1e-3;
            assert!(
                time && found[4] == wanted[6],
                "{kind}: {found:?} {wanted:?}"
            );
            let ids = kind.starts_with("la") || found[5..] == wanted[..2];
            assert!(ids, "{kind}: {found:?} {wanted:?}");
        }
    }
}
