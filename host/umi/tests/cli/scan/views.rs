//! What a scan's points are beside their coordinates: where the sensor was, how it saw them, the grid
//! that they make; and profiles in the form of a published scanner.

use std::path::PathBuf;

use serde_json::{Value, json};

use crate::rig::run::{Folder, project, umi};

fn case(name: &str) -> String {
    let path = PathBuf::from(project("tests/reference/scan")).join(name);
    path.to_str().unwrap().to_owned()
}

fn merge(profiles: &str, machine: &str, out: &str, more: &[&str]) -> Value {
    let triggers = case("merge_3axis.triggers.csv");
    let args = ["scan", "merge", profiles, &triggers, "--machine", machine];
    umi(&[&args, &["-o", out, "--force", "--json"][..], more].concat())
        .exits(0)
        .json()
}

/// The rows of a table, without its titles.
fn rows(path: &str) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    let rows = text.lines().skip(1);
    rows.map(|row| row.split(',').map(|v| v.parse().unwrap()).collect())
        .collect()
}

/// A scan for each profile, in the sensor's frame with its pose, holds the same points in the
/// workpiece's.
#[test]
fn profiles_with_their_poses_are_the_same_cloud() {
    let folder = Folder::new();
    let (profiles, machine) = (case("merge_3axis.profiles.csv"), case("merge_3axis.toml"));
    let cloud = folder.path("cloud.csv");
    merge(&profiles, &machine, &cloud, &[]);
    let posed = folder.path("posed.e57");
    merge(&profiles, &machine, &posed, &["--each-profile"]);
    let bytes = std::fs::read(&posed).unwrap();
    let header = String::from_utf8_lossy(&bytes);
    assert_eq!(header.matches("<pose ").count(), 24);
    let back = folder.path("back.csv");
    umi(&["scan", "convert", &posed, "-o", &back]).exits(0);
    let (back, expected) = (rows(&back), rows(&cloud));
    assert_eq!(back.len(), expected.len());
    for (a, b) in back.iter().zip(&expected) {
        // Its profile and its place there, too.
        assert_eq!((a.len(), b.len()), (5, 5));
        let off = a.iter().zip(b).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0.0, f64::max) < 1e-9, "{a:?} {b:?}");
    }
    // By its pose a point of a profile is what the sensor saw.
    let poses = folder.path("poses.csv");
    merge(&profiles, &machine, &cloud, &["--poses", &poses]);
    let poses = rows(&poses);
    assert_eq!(poses.len(), 24);
    let pose = poses
        .iter()
        .find(|pose| pose[0] == expected[100][0])
        .unwrap();
    let arm: Vec<f64> = (0..3).map(|i| expected[100][2 + i] - pose[1 + i]).collect();
    let local = |k: usize| (0..3).map(|i| pose[4 + 3 * i + k] * arm[i]).sum::<f64>();
    assert!(local(1).abs() < 1e-9, "the laser's plane: {}", local(1));
    // Another format has no poses; both files are not the same.
    let out = folder.path("posed.ply");
    let triggers = case("merge_3axis.triggers.csv");
    let args = ["scan", "merge", &profiles, &triggers, "--machine", &machine];
    let error = umi(&[&args, &["-o", &out, "--each-profile", "--json"][..]].concat());
    assert_eq!(error.exits(1).json()["error"]["code"], "format");
    umi(&[&args, &["-o", &out, "--poses", &out][..]].concat()).exits(1);
    assert!(!PathBuf::from(&out).exists());
}

/// Points out of range, seen from the side, or mixed at an edge are left out, each by its reason.
#[test]
fn what_the_sensor_saw_badly_is_left_out_by_its_reason() {
    let folder = Folder::new();
    let (profiles, machine) = (case("merge_3axis.profiles.csv"), case("merge_3axis.toml"));
    let (cloud, poses) = (folder.path("cloud.csv"), folder.path("poses.csv"));
    let merged = merge(&profiles, &machine, &cloud, &["--poses", &poses]);
    let z: Vec<f64> = {
        let text = std::fs::read_to_string(&profiles).unwrap();
        let last = text
            .lines()
            .skip(1)
            .map(|row| row.rsplit(',').next().unwrap());
        last.filter(|z| !z.is_empty())
            .map(|z| z.parse().unwrap())
            .collect()
    };
    let mut sorted = z.clone();
    sorted.sort_by(f64::total_cmp);
    let (least, most) = (sorted[z.len() / 4] + 1e-6, sorted[3 * z.len() / 4] + 1e-6);
    let range = format!("{least},{most}");
    let out = folder.path("out.csv");
    let filter = |args: &[&str]| {
        let args = [
            &["scan", "filter"][..],
            args,
            &["-o", &out, "--force", "--json"],
        ]
        .concat();
        umi(&args)
    };
    let found = filter(&[&cloud, "--poses", &poses, "--range", &range])
        .exits(0)
        .json();
    // Of another scan, by its profiles; and of this one, moved since.
    let text = std::fs::read_to_string(&poses).unwrap();
    let (head, rest) = text.split_once('\n').unwrap();
    let by_profile: Vec<(&str, &str)> = rest
        .lines()
        .map(|row| row.split_once(',').unwrap())
        .collect();
    let others = by_profile.iter().zip(by_profile.iter().cycle().skip(1));
    let others = others.map(|((profile, _), (_, pose))| format!("{profile},{pose}\n"));
    let foreign = folder.file(
        "foreign.csv",
        format!("{head}\n{}", others.collect::<String>()),
    );
    let text = std::fs::read_to_string(&cloud).unwrap();
    let moved = text.lines().enumerate().map(|(line, row)| {
        let cells: Vec<&str> = row.split(',').collect();
        match (line, cells[2].parse::<f64>()) {
            (0, _) | (_, Err(_)) => format!("{row}\n"),
            (_, Ok(x)) => format!(
                "{},{},{},{},{}\n",
                cells[0],
                cells[1],
                x + 0.1,
                cells[3],
                cells[4]
            ),
        }
    });
    let moved = folder.file("moved.csv", moved.collect::<String>());
    for (cloud, poses) in [(&cloud, &foreign), (&moved, &poses)] {
        for by in [["--range", "-90,90"], ["--incidence", "60"]] {
            let error = filter(&[&[&**cloud, "--poses", poses][..], &by].concat())
                .exits(2)
                .json();
            assert_eq!(error["error"]["code"], "foreign_poses", "{error}");
        }
    }
    // Floats of the same cloud are its own.
    let floats = folder.path("floats.ply");
    merge(&profiles, &machine, &floats, &["--profiles-too"]);
    filter(&[&floats, "--poses", &poses, "--range", "-90,90"]).exits(0);
    let of = |reason: &str| {
        let dropped = found["dropped"].as_array().unwrap();
        let one = dropped.iter().find(|d| d["reason"] == reason);
        one.map_or(0, |d| d["points"].as_u64().unwrap() as usize)
    };
    let count = |keep: &dyn Fn(f64) -> bool| z.iter().filter(|z| keep(**z)).count();
    assert_eq!(of("too_far"), count(&|z| z < least), "{found}");
    assert_eq!(of("too_near"), count(&|z| z > most), "{found}");
    assert_eq!(found["points"], merged["points"]);

    // A step with a point in the middle of it, and a wall of 80 degrees.
    let mut text = String::from("profile,index,x_mm,y_mm,z_mm\n");
    for profile in 0..20 {
        for index in 0..60 {
            let x = 0.1 * f64::from(index);
            let z = match index {
                0..20 => 3.0,
                20 => 1.5,
                21..40 => 0.0,
                _ => (x - 4.0) * 80_f64.to_radians().tan(),
            };
            text += &format!("{profile},{index},{x},{},{z}\n", 0.1 * f64::from(profile));
        }
    }
    let step = folder.file("step.csv", text);
    let gone = folder.path("gone.csv");
    let args = [
        &*step,
        "--mixed",
        "1,1",
        "--incidence",
        "70",
        "--beam",
        "0,0,-2",
        "--dropped",
        &gone,
    ];
    let found = filter(&args).exits(0).json();
    assert_eq!(
        found["dropped"][0],
        json!({"reason": "mixed", "points": 20})
    );
    assert_eq!(found["dropped"][1]["reason"], "steep");
    let steep = found["dropped"][1]["points"].as_u64().unwrap();
    assert!((20 * 18..=20 * 22).contains(&steep), "{found}");
    assert_eq!(rows(&gone).len() as u64, 20 + steep);

    let bare = folder.file("bare.csv", "x,y,z\n1,2,3\n");
    for (args, status, code) in [
        (&[&*bare, "--mixed", "1,1"][..], 2, "no_profiles"),
        (
            &[&*bare, "--poses", &poses, "--range", "0,1"],
            2,
            "no_profiles",
        ),
        (
            &[&*cloud, "--incidence", "60", "--beam", "0,0,0"],
            1,
            "usage",
        ),
        (
            &[&*cloud, "--incidence", "60", "--poses", &cloud],
            1,
            "missing_column",
        ),
    ] {
        let error = filter(args).exits(status).json();
        assert_eq!(error["error"]["code"], code, "{args:?}");
    }
    // Each needs to know where the sensor looked from.
    filter(&[&cloud, "--range", "0,1"]).exits(1);
    filter(&[&cloud, "--incidence", "60"]).exits(1);
    filter(&[&cloud, "--incidence", "95", "--beam", "0,0,-1"]).exits(1);
}

/// The grid of one view becomes a mesh with its holes, which other commands read.
#[test]
fn a_grid_of_one_view_is_a_mesh() {
    let folder = Folder::new();
    let mut text = String::from("profile,index,x_mm,y_mm,z_mm\n");
    for profile in 0..30 {
        for index in 0..40 {
            if (profile, index) == (7, 9) {
                continue;
            }
            let (x, y) = (0.1 * f64::from(index), 0.2 * f64::from(profile));
            text += &format!("{profile},{index},{x},{y},{}\n", 0.1 * x + 5.0);
        }
    }
    let cloud = folder.file("cloud.csv", &text);
    let mesh = folder.path("view.stl");
    umi(&["scan", "convert", &cloud, "-o", &mesh]).exits(0);
    let size = std::fs::metadata(&mesh).unwrap().len();
    assert_eq!((size - 84) / 50, 2 * 29 * 39 - 4);
    let args = ["scan", "compare", &cloud, "--nominal", &mesh, "--json"];
    let found = umi(&args).exits(0).json();
    assert!(found["max_mm"].as_f64().unwrap() < 1e-6, "{found}");
    assert!(
        found["warnings"].to_string().contains("open_mesh"),
        "{found}"
    );
    // No edge is as long as the grid's pitch.
    let args = [
        "scan",
        "convert",
        &cloud,
        "--longest-mm",
        "0.15",
        "--force",
        "--json",
    ];
    let error = umi(&[&args[..], &["-o", &mesh]].concat()).exits(2).json();
    assert_eq!(error["error"]["code"], "no_grid");
    let bare = folder.file("bare.csv", "x,y,z\n1,2,3\n");
    let none = folder.path("none.stl");
    let error = umi(&["scan", "convert", &bare, "-o", &none, "--json"])
        .exits(2)
        .json();
    assert_eq!(error["error"]["code"], "no_grid");
    assert!(!PathBuf::from(&none).exists());
}

/// Three lines a profile, as a published scanner keeps them: the same points; what is cut or out of
/// step is told.
#[test]
fn profiles_of_three_lines_are_the_same_scan() {
    let folder = Folder::new();
    let (profiles, machine) = (case("merge_3axis.profiles.csv"), case("merge_3axis.toml"));
    let text = std::fs::read_to_string(&profiles).unwrap();
    let mut table = String::new();
    let mut lines: Vec<[String; 3]> = Vec::new();
    let mut last = String::new();
    for row in text.lines().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        if cells[0] != last {
            last = cells[0].to_owned();
            let t_ms = cells[2].parse::<f64>().unwrap() / 1e3;
            lines.push([
                format!("Timestamp(ms)\t{t_ms}"),
                "Lateral data".into(),
                "Distance data".into(),
            ]);
        }
        let profile = lines.last_mut().unwrap();
        for (line, cell) in profile[1..].iter_mut().zip(&cells[5..]) {
            *line += &format!("\t{cell}");
        }
    }
    for profile in &lines {
        table += &(profile.join("\n") + "\n");
    }
    let (a, b) = (folder.path("a.csv"), folder.path("b.csv"));
    let expected = merge(&profiles, &machine, &a, &[]);
    let own = folder.file("laserdata.csv", &table);
    let found = merge(&own, &machine, &b, &[]);
    assert_eq!(found["points"], expected["points"]);
    for (a, b) in rows(&a).iter().zip(&rows(&b)) {
        assert_eq!((a[0], &a[2..]), (b[0], &b[2..]));
    }
    let triggers = case("merge_3axis.triggers.csv");
    // A line that is lost shifts all others; a file that was cut.
    let lost: Vec<&str> = table
        .lines()
        .enumerate()
        .filter(|(i, _)| *i != 4)
        .map(|(_, l)| l)
        .collect();
    for (name, text, code) in [
        ("lost.csv", lost.join("\n") + "\n", "corrupt"),
        ("cut.csv", table[..table.len() - 3].to_owned(), "truncated"),
    ] {
        let cut = folder.file(name, text);
        let args = ["scan", "pair", &cut, &triggers, "--json"];
        assert_eq!(umi(&args).exits(1).json()["error"]["code"], code);
    }
}

/// A scale that makes points infinite, and a profile whose last number is cut, leave no point.
#[test]
fn a_point_that_is_none_is_not_written() {
    let folder = Folder::new();
    let (profiles, machine) = (case("merge_3axis.profiles.csv"), case("merge_3axis.toml"));
    let triggers = case("merge_3axis.triggers.csv");
    let out = folder.path("out.csv");
    let refused = |profiles: &str, machine: &str, status: i32| {
        let args = ["scan", "merge", profiles, &triggers, "--machine", machine];
        let ran = umi(&[&args, &["-o", &out, "--json"][..]].concat());
        let error = ran.exits(status).json();
        assert!(!PathBuf::from(&out).exists());
        error["error"]["code"].as_str().unwrap().to_owned()
    };
    let text = std::fs::read_to_string(&machine).unwrap();
    let tiny = text.replacen("counts_per_mm = 1000.0", "counts_per_mm = 1e-320", 1);
    assert_ne!(tiny, text);
    let tiny = folder.file("tiny.toml", tiny);
    assert_eq!(refused(&profiles, &tiny, 2), "not_finite");
    let text = std::fs::read_to_string(&profiles).unwrap();
    let cut = folder.file("cut.csv", &text[..text.len() - 4]);
    assert_eq!(refused(&cut, &machine, 1), "truncated");
}
