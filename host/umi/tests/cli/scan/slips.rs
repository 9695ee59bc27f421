//! What is no fault of a file and may be a slip is told, and what is cut is named.

use std::fmt::Write as _;
use std::path::Path;

use serde_json::{Value, json};

use crate::rig::run::{Folder, project, umi};

fn case(name: &str) -> String {
    project(&format!("tests/reference/scan/{name}"))
}

fn done(args: &[&str]) -> Value {
    let args: Vec<&str> = [&["scan"][..], args, &["--json"]].concat();
    umi(&args).exits(0).json()
}

fn refused(args: &[&str], status: i32, code: &str) -> String {
    let args: Vec<&str> = [&["scan"][..], args, &["--json"]].concat();
    let error = umi(&args).exits(status).json()["error"].clone();
    assert_eq!(error["code"], code, "{args:?}: {error}");
    error["message"].as_str().unwrap().to_owned()
}

/// Points of a ball of 12.7 mm at (40, 0, 30).
fn ball(folder: &Folder) -> String {
    let mut text = String::from("x_mm,y_mm,z_mm\n");
    for i in 0..40 {
        for j in 1..12 {
            let (a, b) = (f64::from(i) * 0.157, f64::from(j) * 0.13);
            let (x, y) = (40.0 + 12.7 * b.sin() * a.cos(), 12.7 * b.sin() * a.sin());
            writeln!(text, "{x},{y},{}", 30.0 + 12.7 * b.cos()).unwrap();
        }
    }
    folder.file("ball.csv", text)
}

/// One spike among points that are microns off decides the greatest deviation: it is named.
#[test]
fn a_single_point_far_off_is_told() {
    let folder = Folder::new();
    let clean = ball(&folder);
    let text = std::fs::read_to_string(&clean).unwrap() + "40,0,46.3\n";
    let spiked = folder.file("spiked.csv", text);
    let nominal = folder.file(
        "ball.toml",
        "kind = \"sphere\"\ncenter_mm = [40, 0, 30]\nradius_mm = 12.698",
    );
    let page = folder.path("page.html");
    let warned = |command: &str, cloud: &str, more: &[&str]| {
        let args = [&[command, cloud, "--nominal", &nominal][..], more].concat();
        done(&args)["warnings"].to_string()
    };
    let more = ["-o", page.as_str(), "--force"];
    for (command, more) in [("compare", &[][..]), ("report", &more)] {
        assert_eq!(warned(command, &clean, more), "null");
        let said = warned(command, &spiked, more);
        let named =
            "stray: point 441 of 441 at 40.0000, 0.0000, 46.3000 is +3.6020 mm off, all others";
        assert!(said.contains(named), "{said}");
    }
    assert!(
        std::fs::read_to_string(&page)
            .unwrap()
            .contains("stray: point 441")
    );
}

#[test]
fn a_shape_in_inches_is_told() {
    let folder = Folder::new();
    let cloud = ball(&folder);
    let warned = |name: &str, text: String| {
        let nominal = folder.file(name, text);
        let found = done(&["compare", &cloud, "--nominal", &nominal]);
        found
            .get("warnings")
            .cloned()
            .unwrap_or(json!([]))
            .to_string()
    };
    for (unit, told) in [
        (1.0, None),
        (25.4, Some("the nominal looks like inches")),
        (1000.0, Some("the nominal looks like metres")),
        (1.0 / 25.4, Some("the cloud looks like inches")),
        (1e-3, Some("the cloud looks like metres")),
    ] {
        let (x, z, r) = (40.0 / unit, 30.0 / unit, 12.7 / unit);
        let said = warned(
            "ball.toml",
            format!("kind = \"sphere\"\ncenter_mm = [{x}, 0, {z}]\nradius_mm = {r}\n"),
        );
        match told {
            None => assert_eq!(said, "[]"),
            Some(told) => assert!(said.contains(told), "{unit}: {said}"),
        }
    }
    // The place in millimetres, the radius alone in inches.
    let said = warned(
        "radius.toml",
        "kind = \"sphere\"\ncenter_mm = [40, 0, 30]\nradius_mm = 0.5\n".to_owned(),
    );
    assert!(said.contains("radius looks like inches"), "{said}");
    // A plane, a cylinder and a cone have no size that a cloud must have; their places tell.
    let mut flat = String::from("x_mm,y_mm,z_mm\n");
    let mut bore = flat.clone();
    for i in 0..400 {
        let (x, y) = (f64::from(i % 20) * 4.0, f64::from(i / 20) * 4.0);
        writeln!(flat, "{x},{y},25.4").unwrap();
        let a = f64::from(i) * 0.1;
        writeln!(bore, "{},{},{y}", 20.0 + 9.0 * a.cos(), 9.0 * a.sin()).unwrap();
    }
    let (flat, bore) = (folder.file("flat.csv", flat), folder.file("bore.csv", bore));
    for (cloud, inches, mm) in [
        (
            &flat,
            "kind = \"plane\"\npoint_mm = [0, 0, 1]\nnormal = [0, 0, 1]\n",
            "kind = \"plane\"\npoint_mm = [0, 0, 25.0]\nnormal = [0, 0, 1]\n",
        ),
        (
            &bore,
            "kind = \"cylinder\"\npoint_mm = [0.7874015748, 0, 0]\ndirection = [0, 0, 1]\nradius_mm = 0.3543307087\n",
            "kind = \"cylinder\"\npoint_mm = [20.3, 0, 0]\ndirection = [0, 0, 1]\nradius_mm = 9.2\n",
        ),
    ] {
        for (text, told) in [(inches, true), (mm, false)] {
            let nominal = folder.file("nominal.toml", text);
            let found = done(&["compare", cloud, "--nominal", &nominal]);
            let said = found
                .get("warnings")
                .map(Value::to_string)
                .unwrap_or_default();
            assert_eq!(said.contains("inches"), told, "{text}: {found}");
        }
    }
}

/// A countersink of 90 degrees whose half angle somebody wrote in radians.
#[test]
fn a_cone_whose_angle_is_in_radians_is_told() {
    let folder = Folder::new();
    let mut text = String::from("x_mm,y_mm,z_mm\n");
    for i in 0..60 {
        for j in 1..20 {
            let (a, h) = (f64::from(i) * 0.105, f64::from(j));
            let (x, y) = (h * a.cos(), h * a.sin());
            writeln!(text, "{x},{y},{}", h + 0.01 * (7.0 * a).sin()).unwrap();
        }
    }
    let cloud = folder.file("cone.csv", text);
    let warned = |half_angle: &str| {
        let text = format!(
            "kind = \"cone\"\napex_mm = [0, 0, 0]\ndirection = [0, 0, 1]\nhalf_angle_deg = {half_angle}\n"
        );
        let nominal = folder.file("cone.toml", text);
        done(&["compare", &cloud, "--nominal", &nominal])["warnings"].to_string()
    };
    assert_eq!(warned("45.0"), "null");
    let told = warned("0.785398");
    assert!(
        told.contains("angle_unit") && told.contains("45.000 degrees"),
        "{told}"
    );
    // A wrong angle that would be no better in radians.
    assert_eq!(warned("1.2"), "null");
}

/// A tetrahedron as text; its faces in the order and sense that is wanted.
fn stl(faces: &[[[f64; 3]; 3]]) -> String {
    let mut text = String::from("solid s\n");
    for face in faces {
        text += "facet normal 0 0 0\nouter loop\n";
        for [x, y, z] in face {
            writeln!(text, "vertex {x} {y} {z}").unwrap();
        }
        text += "endloop\nendfacet\n";
    }
    text + "endsolid s\n"
}

const CORNERS: [[f64; 3]; 4] = [[0.0; 3], [9.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, 0.0, 9.0]];

fn solid() -> Vec<[[f64; 3]; 3]> {
    let [o, x, y, z] = CORNERS;
    vec![[o, y, x], [o, x, z], [o, z, y], [x, y, z]]
}

/// A sensor's clock that stands, or is rounded to milliseconds, is named; its frame counter, which is right, stands for no
/// time, whichever way it runs.
#[test]
fn a_clock_that_cannot_be_used_is_named_whatever_the_frame_counter_says() {
    let folder = Folder::new();
    let mut latches = String::from(
        "event,number,cause,t_ns,x_counts,y_counts,z_counts,w_counts,axis5_counts,axis6_counts,lost\n",
    );
    let times: Vec<u64> = (0..60_u64)
        .map(|k| 1_000_000 + 5000 * k + k * k * 7919 % 1601)
        .collect();
    for (k, t) in times.iter().enumerate() {
        writeln!(latches, "latch,{k},output,{t}000,{k},0,0,,,,0").unwrap();
    }
    let latches = folder.file("latches.csv", latches);
    let pair = |clock: &dyn Fn(u64) -> u64, more: &[&str]| {
        let mut text = String::from("profile,frame,t_us,encoder,index,x_mm,z_mm\n");
        for (k, t) in times.iter().enumerate() {
            writeln!(text, "{k},{k},{},,0,1,2", clock(*t)).unwrap();
        }
        let profiles = folder.file("profiles.csv", text);
        umi(&[&["scan", "pair", &profiles, &latches, "--json"], more].concat())
    };
    let refused = |clock: &dyn Fn(u64) -> u64| {
        let error = pair(clock, &[]).exits(2).json()["error"].clone();
        assert_eq!(error["code"], "no_match", "{error}");
        error["message"].as_str().unwrap().to_owned()
    };
    for clock in [|_: u64| 0_u64, |_| 77, |t| t / 1_000_000] {
        let said = refused(&clock);
        assert!(said.contains("stands still, or is too coarse"), "{said}");
        assert!(
            said.contains("frame counter cannot stand for the times"),
            "{said}"
        );
    }
    let said = refused(&|t| t / 1000 * 1000);
    assert!(
        said.contains("in steps of 1000 µs: give --jitter-us 600"),
        "{said}"
    );
    let found = pair(&|t| t / 1000 * 1000, &["--jitter-us", "600"])
        .exits(0)
        .json();
    let pairs = found["pairs"].as_array().unwrap();
    assert_eq!(pairs.len(), 60);
    assert!(
        pairs.iter().all(|pair| pair["profile"] == pair["number"]),
        "{found}"
    );
    // An even train has steps as wide as its intervals, and a clock that is right.
    let said = refused(&|t| (t - 1_000_000) / 5000 * 35_000);
    assert!(!said.contains("steps of"), "{said}");
    // A foreign train is just that.
    let said = {
        let error = pair(&|t| t * t % 999_983 + 3 * t, &[]).exits(2).json();
        error["error"]["message"].as_str().unwrap().to_owned()
    };
    assert!(
        !said.contains("steps") && !said.contains("stands"),
        "{said}"
    );
}

/// A box at the origin, 20 mm each way, and points of its faces.
fn cube(side: f64) -> Vec<[[f64; 3]; 3]> {
    let corner = |k: usize| [k & 1, (k >> 1) & 1, k >> 2].map(|bit| side * bit as f64);
    let faces = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let halves = faces.map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
    let halves = halves.into_iter().flatten();
    halves.map(|three| three.map(corner)).collect()
}

fn on_cube(at: [f64; 3]) -> String {
    let mut text = String::from("x_mm,y_mm,z_mm\n");
    for face in cube(20.0) {
        let [a, b, c] = face;
        for (u, v) in [(0.2, 0.3), (0.6, 0.1), (0.1, 0.6), (0.0, 0.0), (1.0, 0.0)] {
            let p = [0, 1, 2].map(|k| at[k] + a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k]));
            writeln!(text, "{},{},{}", p[0], p[1], p[2]).unwrap();
        }
    }
    text
}

/// A cloud that lies beside its nominal is told so and no unit is blamed, wherever it lies; another unit is still told,
/// in place and elsewhere; after an alignment from afar, too.
#[test]
fn a_cloud_that_lies_elsewhere_is_no_other_unit() {
    let folder = Folder::new();
    let mesh = folder.file("mm.stl", stl(&cube(20.0)));
    let inches = folder.file("inches.stl", stl(&cube(20.0 / 25.4)));
    let ball = folder.file(
        "ball.toml",
        "kind = \"sphere\"\ncenter_mm = [10, 10, 10]\nradius_mm = 10\n",
    );
    let said = |cloud: &str, nominal: &str, more: &[&str]| {
        let found = done(&[&["compare", cloud, "--nominal", nominal], more].concat());
        let said = found.get("warnings").map(Value::to_string);
        said.unwrap_or_default()
    };
    for at in [
        [500.0, 0.0, 0.0],
        [0.0, -480.0, 0.0],
        [250.0, 250.0, 250.0],
        [0.0, 0.0, 1000.0],
        [-30.0, 0.0, 0.0],
        [19_000.0, 500.0, 0.0],
    ] {
        let cloud = folder.file("beside.csv", on_cube(at));
        for nominal in [&mesh, &ball] {
            let said = said(&cloud, nominal, &[]);
            assert!(said.contains("elsewhere: the cloud spans"), "{at:?} {said}");
            assert!(
                !said.contains("inches") && !said.contains("metres"),
                "{at:?} {said}"
            );
        }
        let told = said(&cloud, &inches, &[]);
        assert!(
            told.contains("the nominal looks like inches"),
            "{at:?} {told}"
        );
        let aligned = said(&cloud, &mesh, &["--align", "--lock", "rx,ry,rz"]);
        assert!(
            aligned.contains("that was before --align"),
            "{at:?} {aligned}"
        );
    }
    let cloud = folder.file("there.csv", on_cube([0.0; 3]));
    assert_eq!(said(&cloud, &mesh, &[]), "");
    assert_eq!(said(&cloud, &mesh, &["--align"]), "");
    assert!(said(&cloud, &inches, &[]).contains("the nominal looks like inches"));
    // A corner of a large plate, some millimetres off: small, as in inches, and the other reason is named with it.
    let plate = folder.file("plate.stl", stl(&cube(508.0)));
    let off = folder.file("off.csv", on_cube([3.0, 3.0, 3.0]));
    assert!(said(&off, &plate, &[]).contains("or it is a small part of the nominal"));
}

#[test]
fn faces_that_were_turned_and_bodies_without_volume_are_told() {
    let folder = Folder::new();
    let cloud = folder.file("cloud.csv", "x,y,z\n1,1,0\n2,1,0\n1,3,0.01\n4,1,-0.01\n");
    let page = folder.path("page.html");
    let mut one = solid();
    one[1].swap(0, 1);
    let [o, x, y, _] = CORNERS;
    for (faces, name) in [
        (solid(), None),
        (one, Some("turned_faces: 1 of 4 faces")),
        (vec![[o, y, x], [o, x, y]], Some("no_volume")),
        (vec![[o, y, x]], Some("flat_mesh")),
    ] {
        let mesh = folder.file("part.stl", stl(&faces));
        let found = done(&["compare", &cloud, "--nominal", &mesh]);
        let said = found
            .get("warnings")
            .map(Value::to_string)
            .unwrap_or_default();
        match name {
            None => assert_eq!(said, ""),
            Some(name) => assert!(said.contains(name), "{name}: {said}"),
        }
        // The page says the same.
        let told = done(&["report", &cloud, "--nominal", &mesh, "-o", &page, "--force"]);
        assert_eq!(told.get("warnings"), found.get("warnings"));
        let html = std::fs::read_to_string(&page).unwrap();
        assert!(name.is_none_or(|name| html.contains(name)), "{name:?}");
    }
}

/// What `machine check` notes of a file is told by every command that uses it.
#[test]
fn a_slip_in_the_machine_file_is_told_wherever_it_is_used() {
    let folder = Folder::new();
    let mut text = std::fs::read_to_string(case("merge_3axis.toml")).unwrap();
    text += "\n[[joint]]\nname = \"W\"\nkind = \"linear\"\ndirection = [0, 0, 1]\ncolumn = \"x\"\ncounts_per_mm = 1\norigin_counts = 0\n\
             [[joint]]\nname = \"B\"\nkind = \"rotary\"\ndirection = [0, 1, 0]\npoint_mm = [0, 0, 0]\nvalue = 1.5708\n";
    let machine = folder.file("machine.toml", &text);
    let checked = done(&["machine", "check", &machine])["warnings"].clone();
    let checked = checked.as_array().unwrap();
    assert!(checked.len() >= 4, "{checked:?}");
    for word in ["neither chain", "same input", "radians, 90 degrees"] {
        assert!(
            Value::from(checked.clone()).to_string().contains(word),
            "{word}"
        );
    }
    let out = folder.path("cloud.csv");
    let merged = done(&[
        "merge",
        &case("merge_3axis.profiles.csv"),
        &case("merge_3axis.triggers.csv"),
        "--machine",
        &machine,
        "-o",
        &out,
    ]);
    let mut table = String::new();
    let joints: Vec<&str> = ["X", "Y", "Z"].into_iter().collect();
    writeln!(table, "{}\n1,2,3", joints.join(",")).unwrap();
    let posed = done(&["pose", &machine, &folder.file("at.csv", table)]);
    for warning in checked {
        assert!(
            merged["warnings"].as_array().unwrap().contains(warning),
            "{merged}"
        );
        assert!(
            posed["warnings"].as_array().unwrap().contains(warning),
            "{posed}"
        );
    }
}

#[test]
fn angles_within_a_turn_in_radians_are_told() {
    let folder = Folder::new();
    let machine = case("pose_table_table.toml");
    let rows = std::fs::read_to_string(case("pose_table_table.positions.csv")).unwrap();
    let head = rows.lines().next().unwrap();
    let said = |angle: &str| {
        let cells: Vec<&str> = head
            .split(',')
            .map(|name| {
                if ["A", "B", "C"].contains(&name) {
                    angle
                } else {
                    "1"
                }
            })
            .collect();
        let table = folder.file("at.csv", format!("{head}\n{}\n", cells.join(",")));
        let found = done(&["pose", &machine, &table]);
        found
            .get("warnings")
            .map(Value::to_string)
            .unwrap_or_default()
    };
    assert!(said("1.5707963").contains("radians"));
    assert!(!said("90").contains("radians"));
    assert!(!said("0").contains("radians"));
}

#[test]
fn points_without_names_are_a_cloud_to_every_command() {
    let folder = Folder::new();
    let mut text = String::new();
    for k in 0..30 {
        writeln!(text, "{k}, {}, 0.5", k % 7).unwrap();
    }
    for (name, text) in [("a.csv", text.clone()), ("a.txt", text.replace(',', "  "))] {
        let cloud = folder.file(name, text);
        let out = folder.path("out.csv");
        for args in [
            &["convert", &cloud][..],
            &["crop", &cloud, "--box", "-9,-9,-9,99,99,99"],
            &["filter", &cloud, "--isolated", "9,2"],
            &["sample", &cloud, "--every", "1"],
        ] {
            let found = done(&[args, &["-o", &out, "--force"]].concat());
            assert_eq!(found["kept"], 30, "{args:?}: {found}");
            let written = std::fs::read_to_string(&out).unwrap();
            assert!(
                written.starts_with("x_mm,y_mm,z_mm\n0,0,0.5\n1,1,0.5\n"),
                "{written}"
            );
        }
        let nominal = folder.file(
            "flat.toml",
            "kind = \"plane\"\npoint_mm = [0, 0, 0]\nnormal = [0, 0, 1]\n",
        );
        assert_eq!(
            done(&["compare", &cloud, "--nominal", &nominal])["mean_mm"],
            0.5
        );
    }
}

/// What a file says beside the coordinates goes with the points, wherever the next format has a place for it.
#[test]
fn no_format_loses_what_it_can_hold() {
    let folder = Folder::new();
    let mut text = String::from("profile,index,x_mm,y_mm,z_mm,intensity\n");
    for k in 0..20 {
        writeln!(text, "{},{},{k},2,3,{}", k / 5 + 3, k % 5, 7 * k).unwrap();
    }
    let cloud = folder.file("cloud.csv", &text);
    for extension in ["ply", "pcd", "e57"] {
        let (out, back) = (
            folder.path(&format!("a.{extension}")),
            folder.path("back.csv"),
        );
        done(&["convert", &cloud, "-o", &out, "--double"]);
        done(&["convert", &out, "-o", &back, "--force"]);
        assert_eq!(std::fs::read_to_string(&back).unwrap(), text, "{extension}");
        let found = done(&["crop", &out, "--profiles", "4-5", "-o", &back, "--force"]);
        assert_eq!(found["kept"], 10, "{extension}");
    }
    for extension in ["las", "laz"] {
        let (out, back) = (
            folder.path(&format!("a.{extension}")),
            folder.path("back.csv"),
        );
        done(&["convert", &cloud, "-o", &out]);
        done(&["convert", &out, "-o", &back, "--force"]);
        let written = std::fs::read_to_string(&back).unwrap();
        assert!(
            written.starts_with("x_mm,y_mm,z_mm,intensity\n0,2,3,0\n1,2,3,7\n"),
            "{written}"
        );
    }
}

#[test]
fn the_rounding_of_floats_far_out_is_told_or_avoided() {
    let folder = Folder::new();
    let near = folder.file("near.csv", "x,y,z\n1.25,800.3,2\n5,6,7\n");
    let far = folder.file("far.csv", "x,y,z\n123456.789,2,3\n5,6,7\n");
    let late = folder.file("late.csv", "x,y,z\n5,6,7\n123456.789,2,3\n");
    let said = |cloud: &str, out: &str, more: &[&str]| {
        let out = folder.path(out);
        let found = done(&[&["convert", cloud, "-o", &out, "--force"], more].concat());
        let head = std::fs::read(&out).unwrap();
        let head = String::from_utf8_lossy(&head[..head.len().min(400)]).into_owned();
        (found["warnings"].to_string(), head)
    };
    let (told, head) = said(&near, "a.ply", &[]);
    assert!(
        told == "null" && head.contains("property float x"),
        "{told} {head}"
    );
    assert!(head.contains("comment offset_mm 0 0 0\n"), "{head}");
    let (_, head) = said(&far, "a.ply", &[]);
    assert!(head.contains("property double x"), "{head}");
    let back = folder.path("back.csv");
    done(&["convert", &folder.path("a.ply"), "-o", &back]);
    let back = std::fs::read_to_string(&back).unwrap();
    assert!(back.contains("123456.789,2,3"), "{back}");
    let (told, head) = said(&late, "a.ply", &[]);
    assert!(
        told.contains("0.00391 mm") && head.contains("property float x"),
        "{told}"
    );
    let (told, _) = said(&late, "a.ply", &["--double"]);
    assert_eq!(told, "null");
    let (told, _) = said(&far, "a.pcd", &[]);
    assert!(told.contains("0.00391 mm"), "{told}");
    let (told, head) = said(&near, "a.pcd", &["--double"]);
    assert!(
        told.contains("PointXYZ") && head.contains("SIZE 8 8 8"),
        "{told}"
    );
    // A merge says it, too.
    let machine = std::fs::read_to_string(case("merge_3axis.toml")).unwrap();
    let at = "translation_mm = [0.0, 0.0, 0.0]";
    assert!(machine.contains(at));
    let moved = folder.file(
        "far.toml",
        machine.replace(at, "translation_mm = [50000, 0, 0]"),
    );
    let merge = |out: &str| {
        let (profiles, triggers) = (
            case("merge_3axis.profiles.csv"),
            case("merge_3axis.triggers.csv"),
        );
        let out = folder.path(out);
        done(&[
            "merge",
            &profiles,
            &triggers,
            "--machine",
            &moved,
            "-o",
            &out,
        ])
    };
    assert!(
        merge("m.pcd")["warnings"]
            .to_string()
            .contains("rounded by up to")
    );
    merge("m.ply");
    let head = std::fs::read(folder.path("m.ply")).unwrap();
    assert!(String::from_utf8_lossy(&head[..300]).contains("property double x"));
}

#[test]
fn what_is_cut_or_not_read_is_named() {
    let folder = Folder::new();
    let out = folder.path("out.csv");
    let cloud = folder.file("cloud.csv", "x,y,z\n1,2,3\n4,5,6\n");
    let table = folder.path("cloud.parquet");
    done(&["convert", &cloud, "-o", &table]);
    assert!(refused(&["convert", &table, "-o", &out], 1, "bad_file").contains("Parquet"));
    let nominal = folder.file("part.stl", stl(&solid()));
    assert!(
        refused(&["compare", &table, "--nominal", &nominal], 1, "bad_file").contains("Parquet")
    );
    // Two bodies, cut within the second, are not the first one alone.
    let two = stl(&solid()).repeat(2);
    let cut = folder.file("cut.stl", &two[..two.len() - 200]);
    assert!(refused(&["compare", &cloud, "--nominal", &cut], 1, "bad_file").contains("cut short"));
    // A text and a binary file that both begin with `solid`, cut anywhere.
    let text = stl(&solid());
    let mut binary = b"solid made by a program".to_vec();
    binary.resize(80, 0);
    binary.extend(4_u32.to_le_bytes());
    for face in solid() {
        binary.extend([0; 12]);
        binary.extend(
            face.as_flattened()
                .iter()
                .flat_map(|mm| (*mm as f32).to_le_bytes()),
        );
        binary.extend([0; 2]);
    }
    for whole in [text.trim_end().as_bytes(), &binary] {
        let path = folder.file("cut.stl", whole);
        done(&["compare", &cloud, "--nominal", &path]);
        assert_eq!(done(&["convert", &path, "-o", &out, "--force"])["kept"], 4);
        for cut in [30, 83, 84, 120, whole.len() - 60, whole.len() - 9] {
            let path = folder.file("cut.stl", &whole[..cut]);
            let said = refused(&["compare", &cloud, "--nominal", &path], 1, "bad_file");
            assert!(said.contains("cut short"), "{cut}: {said}");
            let said = refused(&["convert", &path, "-o", &out, "--force"], 1, "bad_file");
            assert!(said.contains("cut short"), "{cut}: {said}");
        }
    }
}

/// A table whose last line has no end may have lost digits of its last number.
#[test]
fn a_table_whose_last_line_is_cut_is_truncated() {
    let folder = Folder::new();
    let cut = |name: &str| {
        let whole = std::fs::read_to_string(case(name)).unwrap();
        let whole = whole.trim_end();
        folder.file(name, &whole[..whole.len() - 1])
    };
    let positions = cut("pose_table_table.positions.csv");
    refused(
        &["pose", &case("pose_table_table.toml"), &positions],
        1,
        "truncated",
    );
    let machine = case("plane_exact.toml");
    let sensor = |observations: &str, positions: &str| {
        let args = ["calibrate", "sensor", observations, positions];
        let more = ["--machine", &machine, "--on", "plane"];
        refused(&[&args[..], &more].concat(), 1, "truncated");
    };
    let whole = [
        case("plane_exact.observations.csv"),
        case("plane_exact.positions.csv"),
    ];
    sensor(&cut("plane_exact.observations.csv"), &whole[1]);
    sensor(&whole[0], &cut("plane_exact.positions.csv"));
    refused(&["calibrate", "axis", &cut("axis_c.csv")], 1, "truncated");
    let cloud = folder.file("cloud.csv", "x,y,z\n1,2,3\n4,5,6");
    let nominal = folder.file(
        "flat.toml",
        "kind = \"plane\"\npoint_mm = [0, 0, 0]\nnormal = [0, 0, 1]\n",
    );
    let out = folder.path("out.csv");
    refused(&["compare", &cloud, "--nominal", &nominal], 1, "truncated");
    refused(&["convert", &cloud, "-o", &out], 1, "truncated");
    assert!(!Path::new(&out).exists());
}
