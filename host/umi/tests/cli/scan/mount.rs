//! The mount into the machine file, its uncertainty into the points, points into any format.

use std::path::PathBuf;

use serde_json::Value;

use crate::rig::run::{Folder, project, umi};

fn case(name: &str) -> String {
    let path = PathBuf::from(project("tests/reference/scan")).join(name);
    path.to_str().unwrap().to_owned()
}

fn floats(value: &Value) -> Vec<f64> {
    let list = value.as_array().unwrap();
    list.iter().map(|v| v.as_f64().unwrap()).collect()
}

/// The machine file keeps its comments, has the mount to the last bit, and says how uncertain it is.
#[test]
fn a_calibrated_mount_goes_into_the_machine_file() {
    let folder = Folder::new();
    let machine = format!(
        "# the shop's own\n{}",
        std::fs::read_to_string(case("sphere_noisy.toml")).unwrap()
    );
    let machine = folder.file("machine.toml", machine);
    let (out, residuals) = (folder.path("calibrated.toml"), folder.path("residuals.csv"));
    let calibrate = |machine: &str, more: &[&str]| {
        let (seen, at) = (
            case("sphere_noisy.observations.csv"),
            case("sphere_noisy.positions.csv"),
        );
        let args = ["scan", "calibrate", "sensor", &seen, &at];
        let fixed = [
            "--on",
            "sphere",
            "--radius-mm",
            "15",
            "--json",
            "--machine",
            machine,
        ];
        umi(&[&args, &fixed[..], more].concat())
    };
    let more = ["-o", &out, "--residuals", &residuals];
    let found = calibrate(&machine, &more).exits(0).json();
    let text = std::fs::read_to_string(&out).unwrap();
    assert!(text.starts_with("# the shop's own\n"), "{text}");
    // What was found is where the next one starts, and stays there.
    let again = calibrate(&out, &[]).exits(0).json();
    for (a, b) in floats(&found["translation_mm"])
        .iter()
        .zip(floats(&again["translation_mm"]))
    {
        assert!((a - b).abs() < 1e-7, "{a} {b}");
    }
    let table = std::fs::read_to_string(&residuals).unwrap();
    let squares: f64 = table
        .lines()
        .skip(1)
        .map(|row| row.rsplit(',').next().unwrap().parse::<f64>().unwrap())
        .map(|residual| residual * residual)
        .sum();
    let sigma = found["sigma_mm"].as_f64().unwrap();
    let dof = found["dof"].as_f64().unwrap();
    assert!(((squares / dof).sqrt() / sigma - 1.0).abs() < 1e-9);
    // By the residuals' scatter the uncertainty is of the same size.
    for i in 0..6 {
        let [alike, scatter] =
            ["covariance", "covariance_scatter"].map(|name| found[name][i][i].as_f64().unwrap());
        assert!((0.5..2.0).contains(&(alike / scatter)), "{i}: {found}");
    }
    // The page shows every residual where it is, with the figures of the answer.
    let page = folder.path("page.html");
    calibrate(&machine, &["--report", &page]).exits(0);
    let html = std::fs::read_to_string(&page).unwrap();
    let sigma_shown = format!("{sigma:.6} mm");
    for shown in [
        &*sigma_shown,
        "Residuals of each feature",
        "Content-Security-Policy",
        "<svg",
    ] {
        assert!(html.contains(shown), "{shown}");
    }
    assert!(!html.contains("Sections") && !html.contains("NaN"));
    assert!(!html.contains("src=\"http"));
    calibrate(
        &machine,
        &["--report", &page, "--residuals", &page, "--force"],
    )
    .exits(1);
    // An input is never replaced, a file that is there only if that is wanted.
    calibrate(&machine, &["-o", &machine, "--force"]).exits(1);
    calibrate(&machine, &["-o", &out]).exits(1);
}

/// A ball bar is told beside its certificate, and refused where it is off.
#[test]
fn a_bar_is_told_beside_its_certificate() {
    let folder = Folder::new();
    let (seen, at) = (
        case("spheres_three_known.observations.csv"),
        case("spheres_three_known.positions.csv"),
    );
    let machine = case("spheres_three_known.toml");
    // Three axes: the shift is not seen without the centres, and is held.
    let fixed = [
        "scan",
        "calibrate",
        "sensor",
        &seen,
        &at,
        "--machine",
        &machine,
    ];
    let more = [
        "--on",
        "sphere",
        "--radius-mm",
        "12.7",
        "--hold",
        "tx,ty,tz",
        "--json",
    ];
    let run = |bars: &[&str]| umi(&[&fixed[..], &more, bars].concat());
    // From the centres that the touch probe found: balls 0 and 1.
    let bar = "0,1,274.21687,0.05";
    let page = folder.path("page.html");
    let found = run(&["--bar", bar, "--report", &page]).exits(0).json();
    let bar = &found["bars"][0];
    let (off, u) = (
        bar["off_mm"].as_f64().unwrap(),
        bar["u_mm"].as_f64().unwrap(),
    );
    assert!(u > 0.0 && u < 0.02 && off.abs() < 5.0 * u, "{found}");
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(html.contains("Ball bars beside their certificates"));
    let error = run(&["--bar", "0,1,274.5,0.05"]).exits(2).json();
    assert_eq!(error["error"]["code"], "bar_length", "{error}");
    let error = run(&["--bar", "0,9,274.5,0.05"]).exits(2).json();
    assert_eq!(error["error"]["code"], "missing_centre");
    run(&["--bar", "0,1,274.5"]).exits(1);
    run(&[
        "--bar",
        "0,1,274.2,1",
        "--centres",
        &case("spheres_three_known.centres.csv"),
    ])
    .exits(1);
}

fn merge(folder: &Folder, triggers: &str, machine: &str, name: &str, more: &[&str]) -> Value {
    let out = folder.path(name);
    let profiles = case("merge_3axis.profiles.csv");
    let args = ["scan", "merge", &profiles, triggers, "--machine", machine];
    umi(&[&args, &["-o", &out, "--force", "--json"][..], more].concat())
        .exits(0)
        .json()
}

/// A covariance in the machine file comes out as the points' uncertainty.
#[test]
fn the_mounts_uncertainty_goes_into_the_points() {
    let folder = Folder::new();
    let triggers = case("merge_3axis.triggers.csv");
    let plain = case("merge_3axis.toml");
    let merged = merge(&folder, &triggers, &plain, "a.ply", &[]);
    assert_eq!(merged.get("mount_u_mm"), None);
    // 3, 4 and 12 um along the axes, no turn: 13 um for every point.
    let text = std::fs::read_to_string(&plain).unwrap();
    let mut covariance = [[0.0; 6]; 6];
    for (i, u) in [0.003_f64, 0.004, 0.012].into_iter().enumerate() {
        covariance[3 + i][3 + i] = u * u;
    }
    let text = text.replace(
        "[sensor]\n",
        &format!("[sensor]\ncovariance = {covariance:?}\n"),
    );
    let machine = folder.file("machine.toml", text);
    let merged = merge(&folder, &triggers, &machine, "b.ply", &[]);
    for name in ["rms_mm", "max_mm"] {
        let u = merged["mount_u_mm"][name].as_f64().unwrap();
        assert!((u - 0.013).abs() < 1e-12, "{merged}");
    }
    // A matrix that is no covariance.
    let text = std::fs::read_to_string(&machine).unwrap();
    let bad = folder.file(
        "bad.toml",
        text.replace("covariance = [[0.0, 0.0", "covariance = [[0.0, 1.0"),
    );
    let profiles = case("merge_3axis.profiles.csv");
    let out = folder.path("c.ply");
    let args = [
        "scan",
        "merge",
        &profiles,
        &triggers,
        "--machine",
        &bad,
        "-o",
        &out,
        "--json",
    ];
    let error = umi(&args).exits(2).json();
    assert_eq!(error["error"]["code"], "machine");
}

/// Each point has its own, in every format that has room for it, and keeps it in the commands behind.
#[test]
fn each_point_has_its_uncertainty_where_that_is_asked_for() {
    let folder = Folder::new();
    let triggers = case("merge_3axis.triggers.csv");
    let plain = std::fs::read_to_string(case("merge_3axis.toml")).unwrap();
    // 3 µm along x, and 2 mrad about each axis: the shift and what the arm makes of the turns.
    let mut covariance = [[0.0; 6]; 6];
    covariance[3][3] = 9e-6;
    (0..3).for_each(|i| covariance[i][i] = 4e-6);
    let text = plain.replace(
        "[sensor]\n",
        &format!("[sensor]\ncovariance = {covariance:?}\n"),
    );
    let machine = folder.file("machine.toml", text);
    let merged = merge(
        &folder,
        &triggers,
        &machine,
        "a.csv",
        &["--uncertainty-too"],
    );
    let table = std::fs::read_to_string(folder.path("a.csv")).unwrap();
    assert!(
        table.starts_with("profile,index,x_mm,y_mm,z_mm,mount_u_mm\n"),
        "{table}"
    );
    let column = |text: &str| -> Vec<f64> {
        let rows = text.lines().skip(1);
        rows.map(|row| row.rsplit(',').next().unwrap().parse().unwrap())
            .collect()
    };
    let found = column(&table);
    // By the samples themselves: both variances across the arm for each turn.
    let profiles = std::fs::read_to_string(case("merge_3axis.profiles.csv")).unwrap();
    let mut wanted = std::collections::HashMap::new();
    for row in profiles.lines().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        if let (Ok(x), Ok(z)) = (cells[5].parse::<f64>(), cells[6].parse::<f64>()) {
            let key = format!("{},{}", cells[0], cells[4]);
            wanted.insert(key, (9e-6 + 2.0 * 4e-6 * (x * x + z * z)).sqrt());
        }
    }
    assert_eq!(found.len() as u64, merged["points"]);
    for (row, u) in table.lines().skip(1).zip(&found) {
        let key = row.split(',').take(2).collect::<Vec<_>>().join(",");
        assert!(
            (u / wanted[&key] - 1.0).abs() < 1e-9,
            "{row} {}",
            wanted[&key]
        );
    }
    let most = found.iter().copied().fold(0.0, f64::max);
    assert!((merged["mount_u_mm"]["max_mm"].as_f64().unwrap() / most - 1.0).abs() < 1e-12);
    for name in ["a.ply", "a.pcd"] {
        let more = ["--uncertainty-too", "--times-too", "--double"];
        merge(&folder, &triggers, &machine, name, &more);
        let back = folder.path("back.csv");
        umi(&[
            "scan",
            "convert",
            &folder.path(name),
            "-o",
            &back,
            "--force",
        ])
        .exits(0);
        let text = std::fs::read_to_string(&back).unwrap();
        assert!(
            text.lines().next().unwrap().ends_with("t_us,mount_u_mm"),
            "{name}"
        );
        for (a, b) in column(&text).iter().zip(&found) {
            assert!((a / b - 1.0).abs() < 1e-6, "{name}: {a} {b}");
        }
    }
    merge(
        &folder,
        &triggers,
        &machine,
        "a.parquet",
        &["--uncertainty-too"],
    );
    // What has no room says so; so does a mount of which nothing is known.
    let profiles = case("merge_3axis.profiles.csv");
    let refused = |machine: &str, name: &str| {
        let out = folder.path(name);
        let args = [
            "scan",
            "merge",
            &profiles,
            &triggers,
            "--machine",
            machine,
            "-o",
            &out,
        ];
        let ran = umi(&[&args[..], &["--uncertainty-too", "--json"]].concat());
        assert!(!PathBuf::from(&out).exists(), "{name}");
        let status = ran.status;
        (
            status,
            ran.json()["error"]["code"].as_str().unwrap().to_owned(),
        )
    };
    assert_eq!(refused(&machine, "a.laz"), (1, "format".into()));
    assert_eq!(
        refused(&case("merge_3axis.toml"), "b.csv"),
        (2, "no_uncertainty".into())
    );
    let out = folder.path("b.laz");
    let told = umi(&[
        "scan",
        "convert",
        &folder.path("a.csv"),
        "-o",
        &out,
        "--json",
    ]);
    let told = told.exits(0).json();
    assert!(
        told["warnings"].to_string().contains("mount_u_mm"),
        "{told}"
    );
}

/// A merge writes every format that a cloud has, with the same points; what is refused leaves no
/// file.
#[test]
fn a_merge_writes_every_format() {
    let folder = Folder::new();
    let triggers = case("merge_3axis.triggers.csv");
    let machine = case("merge_3axis.toml");
    merge(&folder, &triggers, &machine, "cloud.csv", &[]);
    let rows = |name: &str| -> Vec<Vec<f64>> {
        let text = std::fs::read_to_string(folder.path(name)).unwrap();
        let rows = text.lines().skip(1);
        rows.map(|row| row.split(',').map(|v| v.parse().unwrap()).collect())
            .collect()
    };
    let expected = rows("cloud.csv");
    for extension in ["e57", "laz", "las", "pcd"] {
        let name = format!("cloud.{extension}");
        let merged = merge(&folder, &triggers, &machine, &name, &["--double"]);
        assert_eq!(merged["points"], expected.len());
        let back = folder.path("back.csv");
        umi(&[
            "scan",
            "convert",
            &folder.path(&name),
            "-o",
            &back,
            "--force",
        ])
        .exits(0);
        let found = rows("back.csv");
        assert_eq!(found.len(), expected.len(), "{extension}");
        for (a, b) in found.iter().zip(&expected) {
            let (a, b) = (&a[a.len() - 3..], &b[b.len() - 3..]);
            let off = a.iter().zip(b).map(|(a, b)| (a - b).abs());
            assert!(off.fold(0.0, f64::max) < 1e-4, "{extension}: {a:?} {b:?}");
        }
    }
    let merged = merge(&folder, &triggers, &machine, "cloud.parquet", &[]);
    assert_eq!(merged["points"], expected.len());
    let out = folder.path("cloud.xyz");
    let profiles = case("merge_3axis.profiles.csv");
    let args = [
        "scan",
        "merge",
        &profiles,
        &triggers,
        "--machine",
        &machine,
        "-o",
        &out,
        "--json",
    ];
    let error = umi(&args).exits(1).json();
    assert_eq!(error["error"]["code"], "format");
    // Half a scan: the capture ends within a message.
    let capture = std::fs::read(case("merge_gocator.gocator")).unwrap();
    let cut = folder.file("cut.gocator", &capture[..capture.len() - 9]);
    let out = folder.path("cut.e57");
    let args = [
        "scan",
        "merge",
        &cut,
        &case("merge_gocator.triggers.csv"),
        "--machine",
        &case("merge_gocator.toml"),
        "-o",
        &out,
        "--json",
    ];
    umi(&args).exits(1);
    assert!(!PathBuf::from(&out).exists());
    assert!(!PathBuf::from(format!("{out}.part")).exists());
}

/// Cone and torus, limits, histogram, alignment with what is locked; another unit is named.
#[test]
fn a_cloud_is_compared_with_more_than_a_ball() {
    let folder = Folder::new();
    let mut cloud = String::from("x_mm,y_mm,z_mm\n");
    let mut points = Vec::new();
    for i in 0..30 {
        for k in 1..10 {
            let (angle, height) = (0.7 * f64::from(i), f64::from(k));
            let across = height * 30_f64.to_radians().tan();
            points.push([across * angle.cos(), across * angle.sin(), height]);
        }
    }
    for [x, y, z] in &points {
        cloud += &format!("{},{},{}\n", x + 0.1, y - 0.2, z + 0.05);
    }
    let cloud = folder.file("cloud.csv", cloud);
    let cone = folder.file(
        "cone.toml",
        "kind = \"cone\"\napex_mm = [0, 0, 0]\ndirection = [0, 0, 1]\nhalf_angle_deg = 30\n",
    );
    let compare = |nominal: &str, more: &[&str]| {
        let args = ["scan", "compare", &cloud, "--nominal", nominal, "--json"];
        umi(&[&args[..], more].concat())
    };
    let found = compare(&cone, &["--limits", "-0.05,0.05", "--histogram", "7"]);
    let found = found.exits(0).json();
    assert!(found["rms_mm"].as_f64().unwrap() > 0.05, "{found}");
    let counts = floats(&found["histogram"]["counts"]);
    assert_eq!(counts.len(), 7);
    assert_eq!(counts.iter().sum::<f64>(), points.len() as f64);
    let limits = &found["limits"];
    let [below, within, above] = ["below", "within", "above"].map(|n| limits[n].as_u64().unwrap());
    assert!(below > 0 && within > 0 && above > 0);
    assert_eq!(below + within + above, points.len() as u64);
    let found = compare(&cone, &["--align"]).exits(0).json();
    assert!(found["rms_mm"].as_f64().unwrap() < 1e-7, "{found}");
    assert_eq!(found["alignment"]["unseen"], 1);
    let shift = floats(&found["alignment"]["translation_mm"]);
    let locked = compare(&cone, &["--align", "--lock", "rx,ry,rz,tz"])
        .exits(0)
        .json();
    let kept = floats(&locked["alignment"]["translation_mm"]);
    assert_eq!(kept[2], 0.0);
    assert!((kept[0] + 0.1).abs() < 0.01 && (shift[0] + 0.1).abs() < 0.01);
    compare(&cone, &["--lock", "rx"]).exits(1);
    let torus = folder.file(
        "torus.toml",
        "kind = \"torus\"\ncenter_mm = [0, 0, 0]\ndirection = [0, 0, 1]\nmajor_radius_mm = 3\nminor_radius_mm = 3\n",
    );
    let error = compare(&torus, &[]).exits(2).json();
    assert_eq!(error["error"]["code"], "nominal", "{error}");
    // A square of half an inch, open, 25.4 times too small.
    let mut stl = String::from("solid s\n");
    for corners in [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]] {
        stl += "facet normal 0 0 1\nouter loop\n";
        for [x, y] in corners {
            stl += &format!("vertex {} {} 0\n", f64::from(x) * 0.38, f64::from(y) * 0.38);
        }
        stl += "endloop\nendfacet\n";
    }
    let stl = folder.file("inches.stl", stl + "endsolid s\n");
    let found = compare(&stl, &[]).exits(0).json();
    let warnings = found["warnings"].to_string();
    assert!(
        warnings.contains("inches") && warnings.contains("open_mesh"),
        "{found}"
    );
}

/// A profile whose latch was lost is left out, or placed between its neighbours where that is
/// asked for, and named.
#[test]
fn a_profile_without_a_latch_is_left_out_or_placed_and_named() {
    let folder = Folder::new();
    let machine = case("merge_3axis.toml");
    let table = std::fs::read_to_string(case("merge_3axis.triggers.csv")).unwrap();
    let whole = merge(
        &folder,
        &case("merge_3axis.triggers.csv"),
        &machine,
        "whole.csv",
        &[],
    );
    let pairs = whole["pairs"].as_array().unwrap();
    let lost = &pairs[pairs.len() / 2];
    let mut rows: Vec<&str> = table.lines().collect();
    let before = rows.len();
    let number = lost["number"].to_string();
    rows.retain(|row| row.split(',').nth(1) != Some(&number));
    assert_eq!(rows.len(), before - 1);
    let triggers = folder.file("triggers.csv", rows.join("\n") + "\n");
    let out = merge(&folder, &triggers, &machine, "out.csv", &[]);
    assert_eq!(out["unpaired_profiles"][0], lost["profile"]);
    assert!(out["points"].as_u64() < whole["points"].as_u64());
    assert_eq!(out.get("interpolated"), None);
    let more = ["--interpolate-ms", "1000"];
    let out = merge(&folder, &triggers, &machine, "between.csv", &more);
    assert_eq!(out["points"], whole["points"]);
    assert_eq!(out["interpolated"], serde_json::json!([lost["profile"]]));
    assert_eq!(
        out["paired"].as_u64().unwrap() + 1,
        whole["paired"].as_u64().unwrap()
    );
    let rows = |name: &str| {
        let text = std::fs::read_to_string(folder.path(name)).unwrap();
        let key = format!("{},", lost["profile"]);
        let rows = text.lines().filter(|row| row.starts_with(&key));
        rows.map(|row| row.split(',').map(|v| v.parse().unwrap()).collect())
            .collect::<Vec<Vec<f64>>>()
    };
    let (found, expected) = (rows("between.csv"), rows("whole.csv"));
    assert!(!found.is_empty() && found.len() == expected.len());
    for (a, b) in found.iter().zip(&expected) {
        for k in 2..5 {
            assert!((a[k] - b[k]).abs() < 0.5, "{a:?} {b:?}");
        }
    }
    // Its points are marked, and no other; the mark stays from format to format.
    let profile = lost["profile"].as_f64().unwrap();
    let marked = |name: &str| {
        let text = std::fs::read_to_string(folder.path(name)).unwrap();
        let head = text.lines().next().unwrap();
        let mark = head.split(',').position(|name| name == "interpolated");
        let mark = mark.unwrap_or_else(|| panic!("{name}: {head}"));
        let rows = text.lines().skip(1).map(|row| {
            let row: Vec<f64> = row.split(',').map(|v| v.parse().unwrap()).collect();
            ([row[2], row[3], row[4]], row[0], row[mark])
        });
        rows.collect::<Vec<_>>()
    };
    let rows = marked("between.csv");
    assert!(
        rows.iter()
            .all(|(_, of, mark)| (*mark == 1.0) == (*of == profile))
    );
    let with = ["--interpolate-ms", "1000", "--profiles-too"];
    for name in [
        "between.ply",
        "between.pcd",
        "between.parquet",
        "between.laz",
    ] {
        let more = if name.ends_with("laz") {
            &with[..2]
        } else {
            &with[..]
        };
        merge(&folder, &triggers, &machine, name, more);
        if name.ends_with("parquet") {
            continue;
        }
        let back = folder.path(&format!("{name}.csv"));
        umi(&["scan", "convert", &folder.path(name), "-o", &back, "--json"]).exits(0);
        let text = std::fs::read_to_string(&back).unwrap();
        let head = text.lines().next().unwrap();
        assert!(head.ends_with("interpolated"), "{name}: {head}");
        let marks = text.lines().skip(1).map(|row| row.ends_with(",1"));
        let wanted = rows.iter().map(|(_, _, mark)| *mark == 1.0);
        assert!(marks.eq(wanted), "{name}");
    }
    // What has no room for it says so.
    let out = merge(&folder, &triggers, &machine, "between.e57", &with[..2]);
    assert!(
        out["warnings"].to_string().contains("no room for the mark"),
        "{out}"
    );
    // Neighbours that are further apart than allowed place nothing; without a point so placed the file is as ever.
    let more = ["--interpolate-ms", "0.001"];
    let out = merge(&folder, &triggers, &machine, "none.csv", &more);
    assert_eq!(out["interpolated"], serde_json::json!([]));
    for name in ["none.ply", "none.las"] {
        merge(&folder, &triggers, &machine, name, &more);
        let plain = name.replace("none", "out");
        merge(&folder, &triggers, &machine, &plain, &[]);
        let bytes = |name: &str| std::fs::read(folder.path(name)).unwrap();
        assert_eq!(bytes(name), bytes(&plain), "{name}");
    }
    let text = |name: &str| std::fs::read_to_string(folder.path(name)).unwrap();
    assert_eq!(text("none.csv"), text("out.csv"));
}
