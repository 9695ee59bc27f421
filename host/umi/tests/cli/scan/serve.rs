//! `umi scan serve`: a board with a distance sensor, and a shop's program that writes lines.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use umi_protocol::latch::{LatchCause, LatchReport, Positions};
use umi_virtual::serve::{Port, PortPlace};
use umi_virtual::{BoardTime, Config, VirtualBoard};

use crate::rig::run::{Folder, umi, umi_reads};

const SENSOR: &str = "counts_per_mm = [1000, 1000, 1000]
origin_counts = [0, 0, 0]
max_rate_hz = 9000
power_max = 5000
baud = 921600
captured_at = \"sync\"
";

const CAL: &str = r#"{"kind": "point_sensor", "offset_mm": [0, 0, -100], "direction": [0, 0, -1],
"gain": 1, "covariance": null}"#;

/// A board whose sensor reads the distance to a plane at zero, at each pulse. The axes move by a
/// quarter of a millimetre along the beam with each line that is answered.
struct Bench {
    address: String,
    is_over: Arc<AtomicBool>,
    sensor: Option<thread::JoinHandle<()>>,
}

impl Bench {
    fn new() -> Self {
        let config = Config {
            time: BoardTime::Real,
            ..Config::default()
        };
        let board = Arc::new(VirtualBoard::start(config).unwrap());
        let port = Port::open(&PortPlace::Tcp(0)).unwrap();
        let address = port.address.clone();
        port.serve_host(&board);
        let is_over = Arc::new(AtomicBool::new(false));
        let (own, over) = (Arc::clone(&board), Arc::clone(&is_over));
        // A board without encoders refuses pulses: there is nothing to latch.
        own.move_to(Positions {
            counts: [3000, 5000, 144_000].into_iter().collect(),
            t_ns: own.now().0 * 1000,
            ..Positions::default()
        });
        let sensor = thread::spawn(move || {
            let mut number = 0;
            let mut heights = [144.0, 144.25].into_iter().cycle();
            let mut z_mm = 144.0;
            let mut was_odd = false;
            while !over.load(Ordering::Relaxed) {
                let (lines, triggers) = own.sensor_lines();
                if lines.parity != was_odd {
                    was_odd = lines.parity;
                    z_mm = heights.next().unwrap();
                }
                if !triggers {
                    thread::sleep(Duration::from_millis(1));
                    continue;
                }
                let counts = [3000, 5000, (z_mm * 1000.0_f64).round() as i64];
                let t_ns = own.now().0 * 1000;
                own.move_to(Positions {
                    counts: counts.into_iter().collect(),
                    t_ns,
                    ..Positions::default()
                });
                own.latch(LatchReport {
                    number,
                    cause: LatchCause::Trigger,
                    counts: counts.into_iter().collect(),
                    t_ns,
                    missed: 0,
                });
                own.sensor_sends(format!("{number:05} {:.6} 90 3000\r\n", z_mm - 100.0).as_bytes());
                number += 1;
                thread::sleep(Duration::from_micros(200));
            }
        });
        Self {
            address,
            is_over,
            sensor: Some(sensor),
        }
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(sensor) = self.sensor.take() {
            let _ = sensor.join();
        }
    }
}

/// Lines are answered one by one, places are kept, and what cannot be is refused by name.
#[test]
fn lines_are_answered() {
    let (bench, folder) = (Bench::new(), Folder::new());
    let (sensor, cal) = (folder.file("s.toml", SENSOR), folder.file("c.json", CAL));
    let cloud = folder.path("cloud.csv");
    let port = ["--port", bench.address.as_str()];
    let serve = |input: &str, more: &[&str]| {
        let args = [&["scan", "serve"], &port[..], more].concat();
        umi_reads(input.as_bytes(), &args)
    };
    let none = serve("K3\n", &[]).exits(2);
    assert!(none.err.contains("no_sensor") || none.err.contains("no sensor"));

    let set = ["--sensor", &sensor, "--calibration", &cal, "-o", &cloud];
    let said = serve(
        "K1 A2000 B2000 D8 E44 F0 H1\n\nK2\nK2\nK3\nK3\n",
        &[&set[..], &["--json"]].concat(),
    )
    .exits(0)
    .json_lines();
    let of = |kind: &str| -> Vec<_> { said.iter().filter(|it| it["type"] == kind).collect() };
    let (answers, places) = (of("answer"), of("place"));
    assert_eq!((answers.len(), places.len()), (5, 2), "{said:?}");
    for (n, answer) in answers.iter().enumerate() {
        assert_eq!(answer["state"], "ok", "{answer}");
        assert_eq!(answer["variables"]["502"], 1.0);
        assert_eq!(answer["variables"]["503"], n as f64 + 1.0);
    }
    for place in places {
        assert_eq!(place["captures"], 8);
        let z = place["point_mm"][2].as_f64().unwrap();
        assert!(z.abs() < 1e-6, "{place}");
    }
    let kept = std::fs::read_to_string(&cloud).unwrap();
    assert_eq!(kept.lines().count(), 3, "{kept}");

    // Without an output; and what is in force is known.
    assert_eq!(serve("K4\n", &[]).exits(0).out, "6 ok 0.0000\n");
    let refused = serve("K1 A2000 B2000 D0 E44 F0 H1\n", &[]).exits(2);
    let why = "its values are beyond the sensor's";
    assert!(refused.out.contains(why), "{}", refused.out);
    let bad = serve("measure\n", &[]).exits(2);
    assert!(bad.err.contains("K3"), "{}", bad.err);
    serve("UMIP S9 K3 C1\n", &[]).exits(2);
    let args = ["scan", "serve", "--off", port[0], port[1]];
    umi(&args).exits(0);
    serve("K3\n", &[]).exits(2);
}

/// A calibration that warns of the scale, or was made with another lens, is refused before the board has it; one that
/// does not say where it was made is taken, and so is one of this lens.
#[test]
fn calibrations_that_do_not_fit_are_refused() {
    let (bench, folder) = (Bench::new(), Folder::new());
    let sensor = folder.file("s.toml", SENSOR);
    let of_lens = folder.file(
        "l.toml",
        format!("{SENSOR}stand_off_mm = 44\nrange_mm = 8\n"),
    );
    let cal = |name: &str, more: &str| {
        let text = CAL.replace("\"gain\": 1", &format!("\"gain\": 1, {more}"));
        folder.file(name, text)
    };
    let warm = cal("w.json", "\"warnings\": [\"scale: +10.6 ppm\"]");
    let other = cal("o.json", "\"stand_off_mm\": 18.0");
    let same = cal(
        "s.json",
        "\"stand_off_mm\": 43.5, \"warnings\": [\"weak: few\"]",
    );
    let serve = |sensor: &str, cal: &str, input: &str| {
        let args = ["scan", "serve", "--port", &bench.address, "--json"];
        let set = ["--sensor", sensor, "--calibration", cal];
        umi_reads(input.as_bytes(), &[&args[..], &set].concat())
    };
    let line = "\nK1 A2000 B2000 D8 E44 F0 H1\n";
    for (sensor, cal, input, name) in [
        (&sensor, &warm, line.trim_start(), "warm_scale"),
        (&sensor, &warm, "", "warm_scale"),
        (&sensor, &other, line.trim_start(), "other_lens"),
        (&of_lens, &other, "", "other_lens"),
    ] {
        let said = serve(sensor, cal, input).exits(2).json();
        assert_eq!(said["error"]["code"], name, "{said}");
        // The board was told nothing.
        let args = ["scan", "serve", "--port", &bench.address, "--json"];
        let said = umi_reads(b"K3\n", &args).exits(2).json();
        assert_eq!(said["error"]["code"], "no_sensor", "{said}");
    }
    serve(&of_lens, &same, line).exits(0);
    // A later line is not passed on either.
    let later = "K1 A2000 B2000 D8 E44 F0 H1\nK1 A2000 B2000 D8 E18 F0 H1\n";
    let said = serve(&sensor, &same, later).exits(2);
    assert!(said.out.contains("other_lens"), "{}", said.out);
}

/// A sensor that cannot be is refused by its field, and a file with another field is told.
#[test]
fn wrong_sensors_are_named() {
    let (bench, folder) = (Bench::new(), Folder::new());
    let cal = folder.file("c.json", CAL);
    for (text, status, says) in [
        (SENSOR.replace("921600", "12"), 2, "baud"),
        (
            SENSOR.replace("[1000, 1000,", "[0, 1000,"),
            2,
            "counts_per_mm",
        ),
        (format!("{SENSOR}colour = 1\n"), 1, "colour"),
        ("counts = 3".to_owned(), 1, "counts"),
    ] {
        let sensor = folder.file("s.toml", text);
        let args = [
            "scan",
            "serve",
            "--port",
            &bench.address,
            "--sensor",
            &sensor,
            "--calibration",
            &cal,
        ];
        let ran = umi(&args).exits(status);
        assert!(ran.err.contains(says), "{says}: {}", ran.err);
    }
    let missing = folder.path("none.json");
    let sensor = folder.file("s.toml", SENSOR);
    let args = [
        "scan",
        "serve",
        "--port",
        &bench.address,
        "--sensor",
        &sensor,
        "--calibration",
        &missing,
    ];
    umi(&args).exits(1);
}
