//! `umi scan record`: the virtual sensor's stream and the virtual board's latches into files, and
//! from there to points.

use std::fs;
use std::io::Write as _;
use std::net::TcpListener;

use crate::rig::run::{Folder, ScanningMachine, umi};

/// A ring of 41.20 / 19.75 mm on a table, under a sensor of few columns with a clock of its own.
fn scene(more: &str) -> String {
    format!(
        r#"
        [machine]
        start_mm = [0.0, -30.0, 200.0]
        [line_scanner]
        translation_mm = [0.0, 0.0, -195.0]
        samples = 160
        pitch_um = [400, 400]
        noise_um = [5, 5]
        clock_offset_us = 5e6
        clock_drift_ppm = 40
        {more}
        [[body]]
        name = "TABLE"
        shape = "half_space"
        [[body]]
        name = "WASHER"
        shape = {{ ring = {{ radius_mm = 9.875, outer_radius_mm = 20.6, height_mm = 6.3 }} }}
        position_mm = [0.0, 0.0, 6.3]
        "#
    )
}

const PROGRAM: &str = "%\nO1\nG21G90G94\nG4P800\nG1Y30.F2400\nG4P60000\nM30\n%\n";

const MACHINE: &str = r#"
[[joint]]
name = "X"
kind = "linear"
direction = [1, 0, 0]
column = "x"
counts_per_mm = 10000
[[joint]]
name = "Y"
kind = "linear"
direction = [0, 1, 0]
column = "y"
counts_per_mm = 10000
[[joint]]
name = "Z"
kind = "linear"
direction = [0, 0, 1]
column = "z"
counts_per_mm = 10000
[chain]
sensor = ["X", "Y", "Z"]
[sensor]
translation_mm = [0, 0, -195]
"#;

/// Every point of the merged cloud lies on the ring or on the table: a pair that is off by one
/// would move it by 0.2 mm.
fn on_the_washer(cloud: &str) -> usize {
    let text = fs::read_to_string(cloud).unwrap();
    let mut on_top = 0;
    for row in text.lines().skip(1) {
        let cells: Vec<f64> = row.split(',').map(|cell| cell.parse().unwrap()).collect();
        let (x, y, z) = (cells[2], cells[3], cells[4]);
        let r = x.hypot(y);
        if z > 3.0 {
            on_top += 1;
            assert!((z - 6.3).abs() < 0.05, "{row}");
            assert!((9.865..=20.61).contains(&r), "{r}: {row}");
        } else {
            assert!(z.abs() < 0.05, "{row}");
            assert!(!(9.885..=20.59).contains(&r), "{r}: {row}");
        }
    }
    on_top
}

/// Both roles, with losses on the sensor's line: what is lost is told, the rest is where it
/// belongs.
#[test]
fn a_scan_is_recorded_paired_and_merged() {
    for (more, flags, cause) in [
        (
            "lost_share = 0.02\nrepeated_share = 0.03",
            &["--trigger-every-us", "4000"][..],
            "output",
        ),
        (
            "lost_share = 0.02\nevery_us = 4000\nencoder_axis = 1",
            &["--encoder", "y", "--jitter-us", "30", "--drift-ppm", "100"][..],
            "trigger",
        ),
        (
            "lost_share = 0.02\nevery_counts = 1600\nencoder_axis = 1",
            &["--encoder", "y", "--jitter-us", "30", "--drift-ppm", "100"][..],
            "trigger",
        ),
    ] {
        let folder = Folder::new();
        let scene = folder.file("scene.toml", scene(more));
        let program = folder.file("scan.nc", PROGRAM);
        let machine = ScanningMachine::start(&scene, &program);
        let out = folder.path("scan");
        let mut args = vec!["scan", "record", "--json", "--for", "3", "-o", &out];
        args.extend(["--port", &machine.port, "--sensor", &machine.sensor]);
        args.extend(flags);
        let ran = umi(&args);
        let end = ran.json_lines().pop().unwrap();
        let pairing = &end["pairing"];
        let text = end.to_string();
        assert_eq!(ran.status, 2, "{text}");
        assert!(end["lost_frames"].as_u64().unwrap() > 0, "{text}");
        assert_eq!(end["latches_lost"], 0, "{text}");
        let (capture, table) = (
            format!("{out}/profiles.gocator"),
            format!("{out}/triggers.csv"),
        );
        let cloud = folder.path("cloud.csv");
        let machine_file = folder.file("machine.toml", MACHINE);
        let mut args = vec![
            "scan",
            "merge",
            &capture,
            &table,
            "--machine",
            &machine_file,
        ];
        args.extend(["-o", &cloud, "--json"]);
        if cause == "trigger" {
            // An even rhythm with losses: the sensor's encoder says which is which.
            args.extend(["--encoder", "y"]);
        } else {
            assert!(end["repeated"].as_u64().unwrap() > 0, "{text}");
        }
        // So does record at once; in the other role it has the signature.
        let drift = pairing["clock"]["drift_ppm"].as_f64().unwrap();
        assert!((drift + 40.0).abs() < 1.0, "{text}");
        assert!(pairing["paired"].as_u64().unwrap() > 300, "{text}");
        let merged = umi(&args).exits(0).json();
        assert!(merged["paired"].as_u64().unwrap() > 300, "{merged}");
        assert!(on_the_washer(&cloud) > 5000);
        let header = fs::read_to_string(&table).unwrap();
        assert!(header.lines().next().unwrap().ends_with(",lost,what"));
        // What is there is not written over.
        let args = ["scan", "record", "--port", &machine.port, "-o", &out];
        let again = umi(&[&args[..], &["--sensor", &machine.sensor]].concat());
        again.exits(1).says("--force");
    }
}

/// The washer lies on a table that tilts while it is scanned; its machine file has the board's
/// fourth encoder input.
#[test]
fn a_scan_with_a_rotary_axis_is_recorded_and_merged() {
    let folder = Folder::new();
    let tilting = scene("").replace(
        "[line_scanner]",
        "[[machine.rotary]]\nword = \"A\"\ncarries = \"workpiece\"\naxis = [1, 0, 0]\n\
         point_mm = [0, 0, -60]\nlimits_deg = [-30, 30]\n[line_scanner]",
    );
    let scene = folder.file("scene.toml", tilting);
    // 1.5 s, in which the table tilts by 8 degrees.
    let program = "%\nO1\nG21G90G94\nG0A-4.\nG4P800\nG93G1Y30.A4.F40.\nG94G4P60000\nM30\n%\n";
    let program = folder.file("scan.nc", program);
    umi(&["machine", "check", &program, "--scene", &scene]).exits(0);
    let machine = ScanningMachine::start(&scene, &program);
    let out = folder.path("scan");
    let mut args = vec!["scan", "record", "--json", "--for", "3", "-o", &out];
    args.extend(["--port", &machine.port, "--sensor", &machine.sensor]);
    args.extend(["--trigger-every-us", "4000"]);
    umi(&args).exits(0);
    let (capture, table) = (
        format!("{out}/profiles.gocator"),
        format!("{out}/triggers.csv"),
    );
    let rotary = "[[joint]]\nname = \"A\"\nkind = \"rotary\"\ndirection = [1, 0, 0]\n\
                  point_mm = [0, 0, -60]\ncolumn = \"w\"\ncounts_per_deg = 10000\n[chain]\nworkpiece = [\"A\"]";
    let machine_file = folder.file("machine.toml", MACHINE.replace("[chain]", rotary));
    let cloud = folder.path("cloud.csv");
    let mut args = vec!["scan", "merge", &capture, &table, "--json"];
    args.extend(["--machine", &machine_file, "-o", &cloud]);
    let merged = umi(&args).exits(0).json();
    assert!(merged["paired"].as_u64().unwrap() > 300, "{merged}");
    assert!(on_the_washer(&cloud) > 2000);
    // The fourth encoder really moved: without it, points are up to 4 mm off.
    let table = fs::read_to_string(&table).unwrap();
    let place = table
        .lines()
        .next()
        .unwrap()
        .split(',')
        .position(|c| c == "w_counts");
    let place = place.unwrap();
    let counts = table
        .lines()
        .skip(1)
        .map(|l| l.split(',').nth(place).unwrap());
    let counts: Vec<i64> = counts.map(|c| c.parse().unwrap()).collect();
    assert!(counts.iter().max().unwrap() - counts.iter().min().unwrap() > 60_000);
}

/// The files can be read however the recording ended.
#[test]
fn a_recording_that_is_killed_can_be_read() {
    let folder = Folder::new();
    let scene = folder.file("scene.toml", scene(""));
    let program = folder.file("scan.nc", PROGRAM);
    let machine = ScanningMachine::start(&scene, &program);
    let out = folder.path("scan");
    let mut recorder = crate::rig::run::command(&["scan", "record", "-o", &out])
        .args(["--port", &machine.port, "--sensor", &machine.sensor])
        .args(["--trigger-every-us", "3000"])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(2000));
    recorder.kill().unwrap();
    recorder.wait().unwrap();
    let (capture, table) = (
        format!("{out}/profiles.gocator"),
        format!("{out}/triggers.csv"),
    );
    let paired = umi(&["scan", "pair", &capture, &table, "--json"]).exits(0);
    assert!(paired.json()["pairs"].as_array().unwrap().len() > 100);
}

/// An axis that triggers and does not move is named while it is waited for. What is odd about a pairing is told with it.
#[test]
fn a_resting_axis_and_an_even_train_are_told() {
    let folder = Folder::new();
    let scene = folder.file("scene.toml", scene(""));
    let program = folder.file("scan.nc", "%\nO1\nG4P60000\nM30\n%\n");
    let machine = ScanningMachine::start(&scene, &program);
    let record = |out: &str, flags: &[&str]| {
        let out = folder.path(out);
        let mut args = vec!["scan", "record", "--json", "-o", &out];
        args.extend(["--port", &machine.port, "--sensor", &machine.sensor]);
        args.extend(flags);
        let lines = umi(&args).json_lines();
        let silent = lines.iter().find(|line| line["type"] == "silence").cloned();
        (silent, lines.last().unwrap().clone())
    };
    let resting = [
        "--trigger-every-counts",
        "1000",
        "--axis",
        "y",
        "--for",
        "3.5",
    ];
    let (silent, end) = record("resting", &resting);
    let silent = silent.unwrap().to_string();
    assert!(
        silent.contains("does the axis that triggers move"),
        "{silent}"
    );
    assert_eq!(end["pairing"]["error"]["code"], "no_triggers", "{end}");
    let (_, end) = record(
        "even",
        &["--trigger-every-us", "8000", "--even", "--for", "1"],
    );
    let told = end["pairing"]["warnings"].to_string();
    assert!(told.contains("even_train: "), "{end}");
}

/// What is no sensor, or none at all, is told before the board sends a pulse.
#[test]
fn what_is_no_sensor_is_told() {
    let folder = Folder::new();
    let out = folder.path("scan");
    let port = crate::rig::board::Board::new(0).serve();
    let record = |sensor: &str| {
        umi(&[
            "scan", "record", "--port", &port, "-o", &out, "--sensor", sensor,
        ])
    };
    record("192.168.1.10").exits(1).says("tcp:HOST");
    record("tcp:127.0.0.1:1")
        .exits(1)
        .says("no connection to the sensor");
    // What is refused makes no folder, and takes no older recording away.
    assert!(!std::path::Path::new(&out).exists());
    fs::create_dir(&out).unwrap();
    let older = folder.file("scan/triggers.csv", "older");
    let again = ["scan", "record", "--port", &port, "-o", &out, "--force"];
    umi(&[&again[..], &["--sensor", "tcp:127.0.0.1:1"]].concat()).exits(1);
    assert_eq!(fs::read_to_string(older).unwrap(), "older");
    let page = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = format!("tcp:{}", page.local_addr().unwrap());
    std::thread::spawn(move || {
        let (mut stream, _) = page.accept().unwrap();
        let _ = stream.write_all(b"HTTP/1.1 400 Bad Request\r\n\r\n");
        std::thread::sleep(std::time::Duration::from_secs(5));
    });
    let args = ["scan", "record", "--port", &port, "-o", &out, "--force"];
    let ran = umi(&[&args[..], &["--sensor", &place, "--for", "1"]].concat());
    let ran = ran.exits(2);
    assert!(ran.out.contains("is this the data channel"), "{}", ran.out);
}
