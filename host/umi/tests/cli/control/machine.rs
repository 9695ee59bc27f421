//! `umi machine`: a program is checked, run, wired to a board, and its text comes out
//! as a control sends it.

use crate::rig::run::{Folder, project, umi};

const SCENE: &str = "\
[machine]
start_mm = [0.0, 0.0, 100.0]
[probe]
pretravel_mm = 0.0
[[body]]
name = \"FLOOR\"
shape = \"half_space\"
";

const PROGRAM: &str = "\
%
O0007(FLOOR)
G21 G90 G54
G31 Z-5. F50.
#1=#5063
G0 Z20.
POPEN
DPRNT[POINT:*#5061[44]*#5062[44]*#1[44]]
PCLOS
M30
%
";

/// The text leaves as the control sends it, and a file gets every byte.
#[test]
fn a_program_prints_its_point() {
    let folder = Folder::new();
    let (scene, program) = (folder.file("s.toml", SCENE), folder.file("p.nc", PROGRAM));
    let serial = folder.path("serial.txt");
    let args = ["machine", "run", &program, "--scene", &scene];
    let ran = umi(&[&args[..], &["--serial", &serial]].concat()).exits(0);
    assert!(
        ran.out.contains("POINT:     0.0000     0.0000     2.5000"),
        "{}",
        ran.out
    );
    assert!(ran.out.contains("1 hit"), "{}", ran.out);
    let bytes = std::fs::read(&serial).unwrap();
    assert_eq!(bytes, b"\x12POINT:     0.0000     0.0000     2.5000\n\x14");
    let lines = umi(&[&args[..], &["--json"]].concat())
        .exits(0)
        .json_lines();
    let kinds: Vec<&str> = lines.iter().map(|l| l["type"].as_str().unwrap()).collect();
    assert_eq!(
        kinds,
        ["program", "hit", "serial", "serial", "serial", "end"]
    );
    assert_eq!(lines[1]["body"], "FLOOR");
    assert_eq!(lines[1]["stored_mm"][2], 2.5);
}

/// An alarm says where and why, and the exit status says it too.
#[test]
fn an_alarm_ends_the_run() {
    let folder = Folder::new();
    let scene = folder.file("s.toml", SCENE);
    let crash = folder.file("crash.nc", "%\nO1\nG21G90\n\nG1 Z-5. F100.\nM30\n%\n");
    let ran = umi(&["machine", "run", &crash, "--scene", &scene]).exits(2);
    for says in ["O0001 line 5", "collision", "FLOOR", "without skip"] {
        assert!(ran.out.contains(says), "{says}: {}", ran.out);
    }
    let json = umi(&["machine", "run", &crash, "--scene", &scene, "--json"]).exits(2);
    let alarm = json.json_lines().pop().unwrap();
    assert_eq!(
        (alarm["type"].as_str(), alarm["line"].as_u64()),
        (Some("alarm"), Some(5))
    );
}

/// What a control would complain about is said without running, each with its place.
#[test]
fn a_faulty_program_is_checked() {
    let folder = Folder::new();
    let good = folder.file("good.nc", PROGRAM);
    umi(&["machine", "check", &good]).exits(0);
    let bad = folder.file("bad.nc", "%\nO2\nG21\nGOTO77\nG1 X[#1+ F100.\nM30\n%\n");
    let ran = umi(&["machine", "check", &good, &bad]).exits(2);
    for says in ["bad.nc", "line 4", "line 5"] {
        assert!(ran.out.contains(says), "{says}: {}", ran.out);
    }
    let lines = umi(&["machine", "check", &bad, "--json"])
        .exits(2)
        .json_lines();
    let end = lines.last().unwrap();
    assert_eq!(
        (end["type"].as_str(), end["alarms"].as_u64()),
        (Some("check"), Some(2))
    );
    // Another control does not know these words at all.
    umi(&["machine", "check", "--control", "grbl", &good]).exits(2);
}

/// A scene that cannot be used is refused with its place.
#[test]
fn a_faulty_scene_is_refused() {
    let folder = Folder::new();
    let program = folder.file("p.nc", PROGRAM);
    let scene = folder.file("s.toml", "[machine]\nspeed = 1\n");
    umi(&["machine", "run", &program, "--scene", &scene])
        .exits(2)
        .says("speed");
}
/// The whole way on one line: macros, machine, virtual board, verdict, READ.
#[test]
fn a_setup_is_probed_into_a_verdict() {
    let macros = std::fs::read_dir(project("hw/control/fanuc")).unwrap();
    let macros: Vec<String> = macros
        .map(|entry| entry.unwrap().path().to_str().unwrap().to_owned())
        .filter(|path| path.ends_with(".nc"))
        .collect();
    let (program, scene, job) = (
        project("examples/probe-plate.nc"),
        project("examples/scenes/three-spheres.toml"),
        project("examples/three-spheres-witnessed.toml"),
    );
    let mut args = vec!["machine", "run", &program, &program, "--scene", &scene];
    args.extend(["--board", "virtual", "--job", &job, "--read", "--json"]);
    for path in &macros {
        args.extend(["--load", path]);
    }
    let lines = umi(&args).exits(0).json_lines();
    let of = |kind: &str| lines.iter().filter(|l| l["type"] == kind).count();
    assert_eq!((of("verdict"), of("feature"), of("read")), (2, 6, 2));
    // The setup that is taught has no correction: an old one must not run.
    let reads: Vec<_> = lines.iter().filter(|l| l["type"] == "read").collect();
    assert!(reads.iter().all(|read| read["programs"][0] == 9010));
    let has = |at: usize, what: &str| reads[at]["text"].as_str().unwrap().contains(what);
    assert!(has(0, "UMI NO CORRECTION") && !has(1, "UMI NO CORRECTION"));
    // It is of this run alone.
    assert!(has(1, "#3000=2(UMI CORRECTION OF RUN 2)"));
    assert!(lines.iter().all(|l| l["type"] != "fault"), "{lines:?}");
}

/// A `skip.active` that is the wrong way round shows at a desk as it would at a machine: by name, with what to set.
#[test]
fn an_exchanged_skip_level_is_told_at_a_desk() {
    let folder = Folder::new();
    let right = project("examples/three-spheres-witnessed.toml");
    let right = std::fs::read_to_string(right).unwrap();
    assert!(!right.contains("[skip]"));
    let wrong = folder.file("low.toml", right + "\n[skip]\nactive = \"low\"\n");
    let probe = project("examples/probe-plate.nc");
    let mut args = probing(&[&probe], "examples/three-spheres-witnessed.toml");
    let job = args.iter().position(|arg| arg == "--job").unwrap();
    args[job + 1] = wrong;
    args.push("--json".into());
    let lines = run(&args).exits(2).json_lines();
    let verdict = lines.iter().find(|line| line["type"] == "verdict").unwrap();
    let reasons = verdict["reasons"].to_string();
    for says in ["skip_rests_at_touch", "skip.active = "] {
        assert!(reasons.contains(says), "{says}: {reasons}");
    }
}

/// The arguments that probe the example's plate with these programs before a board.
fn probing(programs: &[&str], job: &str) -> Vec<String> {
    let mut args = vec!["machine".to_owned(), "run".to_owned()];
    args.extend(programs.iter().map(|&path| path.to_owned()));
    let macros = std::fs::read_dir(project("hw/control/fanuc")).unwrap();
    args.push("--load".into());
    args.extend(
        macros
            .map(|entry| entry.unwrap().path().to_str().unwrap().to_owned())
            .filter(|path| path.ends_with(".nc")),
    );
    let scene = project("examples/scenes/three-spheres.toml");
    let job = project(job);
    for arg in [
        "--scene", &scene, "--board", "virtual", "--job", &job, "--read",
    ] {
        args.push(arg.into());
    }
    args
}

fn run(args: &[String]) -> crate::rig::run::Ran {
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    umi(&args)
}

/// After a verdict NG the control gets an alarm in place of the correction of the clamping
/// before, and a program that calls it stops there.
#[test]
fn nothing_is_cut_with_an_old_correction() {
    let folder = Folder::new();
    let probe = project("examples/probe-plate.nc");
    let cut = folder.file("cut.nc", "%\nO200\nM98 P9010\nM30\n%\n");
    // The work offset moves between the second and the third clamping.
    let moved = folder.file(
        "moved.nc",
        "%\nO300\nG10 L2 P1 X0.5 Y0 Z0\nM98 P100\nM30\n%\n",
    );
    let sub = std::fs::read_to_string(&probe)
        .unwrap()
        .replace("M30", "M99");
    let sub = folder.file("sub.nc", sub);
    let mut args = probing(
        &[&probe, &probe, &moved, &cut],
        "examples/three-spheres-witnessed.toml",
    );
    args.extend(["--load".into(), sub]);
    let ran = run(&args).exits(2);
    assert_eq!(ran.out.matches("READ O9010").count(), 3, "{}", ran.out);
    let (_, cut) = ran.out.split_once("cut.nc").unwrap();
    assert!(cut.contains("UMI NO OK VERDICT"), "{cut}");
}

/// A board that was to judge and did not is no success.
#[test]
fn no_verdict_is_not_ok() {
    let probe = project("examples/probe-plate.nc");
    // It reads blocks, the macros print checked lines.
    let ran = run(&probing(&[&probe], "examples/three-spheres.toml")).exits(2);
    assert!(ran.out.contains("reached no verdict"), "{}", ran.out);
    // A whole setup, and two of the three balls behind it.
    let folder = Folder::new();
    let text = std::fs::read_to_string(&probe).unwrap();
    let call = text.lines().find(|line| line.contains("P8822")).unwrap();
    let two = "G65 P8820 D25.4 B1. Q40.\nG0 Z171.\nG0 X138. Y-134.7\nG0 Z145.\n\
               G65 P8820 D25.4 B2. Q40.";
    let less = folder.file("less.nc", text.replace(call, two));
    let job = "examples/three-spheres-witnessed.toml";
    let mut args = probing(&[&probe, &less], job);
    let ran = run(&args).exits(2);
    assert!(
        ran.out
            .contains("what was probed behind the last verdict has none"),
        "{}",
        ran.out
    );
    args.push("--json".into());
    let lines = run(&args).exits(2).json_lines();
    let end = lines.last().unwrap();
    assert_eq!(
        (&end["verdicts"], &end["unjudged"]),
        (&1.into(), &true.into())
    );
}

/// A workpiece is cut and measured; a tool that meets it at rapid is named.
#[test]
fn a_workpiece_is_cut() {
    let folder = Folder::new();
    let scene = project("examples/scenes/three-spheres.toml");
    let run = |name: &str, moves: &str| {
        let text = format!(
            "%\nO1\nG21 G90 G54\nT1 M6\nM3 S5000\nG0 X-30. Y0.003 Z100.\n{moves}\nM30\n%\n"
        );
        let program = folder.file(name, text);
        umi(&["machine", "run", &program, "--scene", &scene, "--json"])
    };
    // One lace, 0.01 above the crown of 89.34.
    let lines = run(
        "lace.nc",
        "G0 Z95.\nG1 Z89.35 F500.\nG1 X30. F1000.\nG0 Z120.",
    )
    .exits(0)
    .json_lines();
    let surface = lines.iter().find(|l| l["type"] == "surface").unwrap();
    assert!(
        (surface["min_mm"].as_f64().unwrap() - 0.010).abs() < 1e-4,
        "{surface}"
    );
    assert!(surface["uncut"].as_u64().unwrap() > 0);
    let crash = run("crash.nc", "G0 X0.\nG0 Z90.").exits(2).out;
    assert!(crash.contains("at rapid"), "{crash}");
    // What the control sent before is kept.
    let text = "%\nO1\nG21 G90 G54\nPOPEN\nDPRNT[BEFORE]\nPCLOS\nT1 M6\nM3 S5000\nG0 X0 Y0 Z100.\nG0 Z90.\nM30\n%\n";
    let (program, serial) = (folder.file("kept.nc", text), folder.path("serial.txt"));
    let args = [
        "machine", "run", &program, "--scene", &scene, "--serial", &serial,
    ];
    umi(&args).exits(2).says("at rapid");
    assert_eq!(std::fs::read(&serial).unwrap(), b"\x12BEFORE\n\x14");
}
