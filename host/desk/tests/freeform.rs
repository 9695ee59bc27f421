//! The freeform part of Zapico and others, "CNC centralized control for digitizing freeform
//! surfaces", section 6, again: 90 x 90 mm with a relief of 7 mm, 80 x 80 mm of it at 1 mm, two
//! lenses, three strategies, each way in which the control may hear of a reading.
//!
//! Three lines of it always; the whole is long, so run by hand (`cargo test --release -p umi-desk --test freeform -- --ignored
//! --nocapture`); what it printed last is in `docs/point-sensor.md`.

use nalgebra::Vector3;
use umi_core::point::PointSensor;
use umi_core::point::station::PlaceState;
use umi_core::units::Point;
use umi_desk::digitize::{DigitizeQuestion, Digitized, HeardBy, Strategy, run};
use umi_virtual::scene::Scene;
use umi_virtual::station::SensorLineFault;

/// Height of the relief over the part's datum, mm: waves between -3.5 and 3.5.
fn height(x: f64, y: f64) -> f64 {
    3.5 * (x / 17.0).sin() * (y / 21.0 + 0.5).cos()
}

/// An STL of the part: the relief at a pitch, walls and a floor.
fn part(pitch_mm: f64) -> Vec<u8> {
    let half = 45.0;
    let n = (2.0 * half / pitch_mm).round() as usize;
    let at = |k: usize| -half + 2.0 * half * k as f64 / n as f64;
    let top = |i: usize, j: usize| [at(i), at(j), height(at(i), at(j))];
    let low = |i: usize, j: usize| [at(i), at(j), -30.0];
    let mut triangles: Vec<[[f64; 3]; 3]> = Vec::new();
    for i in 0..n {
        for j in 0..n {
            let (a, b, c, d) = (top(i, j), top(i + 1, j), top(i + 1, j + 1), top(i, j + 1));
            triangles.extend([[a, b, c], [a, c, d]]);
            let (a, b, c, d) = (low(i, j), low(i + 1, j), low(i + 1, j + 1), low(i, j + 1));
            triangles.extend([[a, c, b], [a, d, c]]);
        }
        for (p, q) in [
            ((i + 1, 0), (i, 0)),
            ((i, n), (i + 1, n)),
            ((0, i), (0, i + 1)),
            ((n, i + 1), (n, i)),
        ] {
            let (a, b) = (top(p.0, p.1), top(q.0, q.1));
            let (c, d) = (low(q.0, q.1), low(p.0, p.1));
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        for number in triangle.iter().flatten() {
            bytes.extend((*number as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}

/// The lenses of the paper's table 1: stand-off, depth of field, spot, linearity, half angle,
/// noise of one capture (0.6 s at 3000 Hz, averaged, scatter by 0.06 and 0.10 um).
const LENSES: [(&str, [f64; 6]); 2] = [
    ("50 mm", [44.0, 8.0, 37.0, 0.08, 85.0, 4.2]),
    ("25 mm", [18.0, 1.8, 20.0, 0.17, 75.0, 2.5]),
];

fn scene(lens: &[f64; 6], baud: u32, folder: &std::path::Path) -> Scene {
    let [stand_off, range, spot, linearity, angle, noise] = lens;
    let text = format!(
        r#"
        [machine]
        travel_min_mm = [-500.0, -260.0, -50.0]
        travel_max_mm = [500.0, 260.0, 460.0]
        reference_mm = [0.0, 0.0, 460.0]
        start_mm = [0.0, 0.0, 400.0]
        # The axes stand at once where they stop, as the paper's times take them to.
        position_gain_per_s = 0.0
        position_noise_um = 1.0
        [control]
        baud = {baud}
        [control.nc]
        dialect = "fanuc"
        [point_sensor]
        tool = 98
        offset_mm = [1.3, -0.8, -120.0]
        direction = [0.003490646098723725, -0.0017453177327930258, -0.9999923845989154]
        stand_off_mm = {stand_off}
        range_mm = {range}
        spot_um = {spot}
        noise_um = {noise}
        linearity_percent = {linearity}
        angle_deg = {angle}
        max_rate_hz = 9000
        [[body]]
        name = "PART"
        shape = {{ mesh = {{ file = "part.stl" }} }}
        "#
    );
    Scene::parse_in(&text, folder).unwrap()
}

fn sensor(scene: &Scene) -> PointSensor {
    let spec = scene.point_sensor.as_ref().unwrap();
    PointSensor {
        offset: Point::from_array_mm(spec.offset_mm),
        direction: Vector3::from(spec.direction).normalize(),
        gain: 1.0,
    }
}

fn asked(scene: &Scene, strategy: Strategy, by: HeardBy, size_mm: f64) -> DigitizeQuestion {
    let stand_off = scene.point_sensor.as_ref().unwrap().stand_off_mm;
    let corner = -size_mm / 2.0;
    // Adaptive runs begin over the surface, the others over its middle height.
    let z = if strategy == Strategy::NonAdaptive {
        0.0
    } else {
        height(corner + 1.3, corner - 0.8)
    };
    DigitizeQuestion {
        strategy,
        at_mm: [corner, corner, z + 120.0 + stand_off],
        size_mm: [size_mm; 2],
        step_mm: [1.0, 1.0],
        feed_mm_per_min: 1000.0,
        safe_z_mm: 300.0,
        adaptations: 1.0,
        dof_position: 50.0,
        rate_hz: 2000.0,
        power: 4000.0,
        captures: 400.0,
        by,
    }
}

/// Errors along the surface's normal after the best fit of height and tilt: rms, sigma, range, um.
fn errors(done: &Digitized) -> Option<[f64; 3]> {
    let mut rows = Vec::new();
    for place in &done.places {
        if let Some(point) = place.found.point {
            let (x, y, z) = (point.mm.x, point.mm.y, point.mm.z);
            let h = 1e-4;
            let gx = (height(x + h, y) - height(x - h, y)) / (2.0 * h);
            let gy = (height(x, y + h) - height(x, y - h)) / (2.0 * h);
            let cos = 1.0 / (1.0 + gx * gx + gy * gy).sqrt();
            // A shift along X, Y and Z, and a small turn about each.
            let n = Vector3::new(-gx, -gy, 1.0) * cos;
            let turn = point.mm.cross(&n);
            rows.push((
                [n.x, n.y, n.z, turn.x, turn.y, turn.z],
                (z - height(x, y)) * cos,
            ));
        }
    }
    if rows.len() < 10 {
        return None;
    }
    let mut a = nalgebra::Matrix6::<f64>::zeros();
    let mut b = nalgebra::Vector6::<f64>::zeros();
    for (row, d) in &rows {
        let row = nalgebra::Vector6::from(*row);
        a += row * row.transpose();
        b += row * *d;
    }
    let fit = a.lu().solve(&b)?;
    let left: Vec<f64> = rows
        .iter()
        .map(|(row, d)| (d - nalgebra::Vector6::from(*row).dot(&fit)) * 1e3)
        .collect();
    let n = left.len() as f64;
    let mean = left.iter().sum::<f64>() / n;
    let squares: f64 = left.iter().map(|d| d * d).sum();
    let rms = (squares / n).sqrt();
    let sigma = (squares / n - mean * mean).sqrt();
    let least = left.iter().fold(f64::INFINITY, |a, b| a.min(*b));
    let most = left.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
    Some([rms, sigma, most - least])
}

fn folder() -> std::path::PathBuf {
    let folder = std::path::PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("freeform");
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("part.stl");
    // Written once under another name: several tests may begin at once.
    let own = folder.join(format!("{:?}.stl", std::thread::current().id()));
    std::fs::write(&own, part(0.5)).unwrap();
    std::fs::rename(&own, &path).unwrap();
    folder
}

/// The floor of captures and way alone, s.
fn floor_s(asked: &DigitizeQuestion) -> f64 {
    let [columns, rows] = asked.grid();
    let places = (columns * rows) as f64;
    places * asked.captures / asked.rate_hz + (places - 1.0) * 60.0 / asked.feed_mm_per_min
}

/// What a row of the table came to: lens, strategy, by, baud; the means of its seeds: rms, um, time, s, and
/// its share of the floor, missing places.
struct Row {
    what: (usize, Strategy, HeardBy, u32),
    rms_um: f64,
    seconds: f64,
    of_floor: f64,
    missing: f64,
}

/// What is promised of the table, for lines of 81 places.
fn goals(rows: &[Row], lines: f64) {
    for row in rows {
        let (lens, strategy, by, baud) = row.what;
        let what = format!("{lens} {strategy:?} {by:?} {baud}");
        let rms_of = |wanted: Strategy, by: HeardBy| {
            let is_it = |of: &&Row| of.what.0 == lens && of.what.1 == wanted && of.what.2 == by;
            rows.iter().find(is_it).map(|of| of.rms_um)
        };
        if strategy != Strategy::NonAdaptive {
            assert_eq!(row.missing, 0.0, "{what}");
        }
        if by == HeardBy::Trip && strategy == Strategy::PredictiveAdaptive && baud == 115_200 {
            assert!(row.of_floor <= 1.15, "{what}: {}", row.of_floor);
        }
        if by == HeardBy::Pulses {
            assert!(
                row.seconds < 480.0 / 81.0 * lines,
                "{what}: {}",
                row.seconds
            );
            if let Some(rest) = rms_of(Strategy::NonAdaptive, HeardBy::Served) {
                assert!(row.rms_um < 1.2 * rest, "{what}: {} {rest}", row.rms_um);
            }
        }
        if strategy == Strategy::Adaptive {
            for by in [HeardBy::Served, HeardBy::Trip] {
                if let Some(other) = rms_of(Strategy::PredictiveAdaptive, by) {
                    let apart = (row.rms_um - other).abs();
                    assert!(apart < 0.2, "{what}: {} {other}", row.rms_um);
                }
            }
        }
    }
}

/// Three lines of the part: what is promised of the whole holds there.
#[test]
fn three_lines_of_the_relief() {
    let folder = folder();
    let rows = [
        (0, Strategy::NonAdaptive, HeardBy::Pulses, 9600),
        (0, Strategy::NonAdaptive, HeardBy::Served, 9600),
        (0, Strategy::Adaptive, HeardBy::Served, 115_200),
        (0, Strategy::PredictiveAdaptive, HeardBy::Trip, 115_200),
        (1, Strategy::Adaptive, HeardBy::Served, 115_200),
        (1, Strategy::PredictiveAdaptive, HeardBy::Trip, 115_200),
    ]
    .map(|what| {
        let (lens, strategy, by, baud) = what;
        let scene = scene(&LENSES[lens].1, baud, &folder);
        let mut asked = asked(&scene, strategy, by, 80.0);
        asked.size_mm = [80.0, 2.0];
        let floor_s = floor_s(&asked);
        let done = run(
            scene.clone(),
            &sensor(&scene),
            &asked,
            1,
            SensorLineFault::None,
        )
        .unwrap();
        assert_eq!(
            (done.alarm.clone(), done.places.len(), done.losses),
            (None, 243, 0)
        );
        let [rms_um, ..] = errors(&done).unwrap();
        Row {
            what,
            rms_um,
            seconds: done.duration_s,
            of_floor: done.duration_s / floor_s,
            missing: (done.places.len() - done.points()) as f64,
        }
    });
    goals(&rows, 3.0);
}

/// The whole of table 5.
#[test]
#[ignore = "long: run by hand"]
fn table_5_again() {
    let folder = folder();
    let mut done_rows = Vec::new();
    println!(
        "lens, strategy, by, baud, seed: rms sigma range um; time s, of the floor; way mm; lines, s; missing"
    );
    let all: &[(usize, Strategy, HeardBy, u32)] = &[
        (0, Strategy::NonAdaptive, HeardBy::Pulses, 9600),
        (0, Strategy::NonAdaptive, HeardBy::Served, 9600),
        (0, Strategy::NonAdaptive, HeardBy::Served, 115_200),
        (0, Strategy::Adaptive, HeardBy::Served, 115_200),
        (0, Strategy::PredictiveAdaptive, HeardBy::Served, 115_200),
        (0, Strategy::PredictiveAdaptive, HeardBy::Trip, 115_200),
        (1, Strategy::NonAdaptive, HeardBy::Served, 115_200),
        (1, Strategy::Adaptive, HeardBy::Served, 115_200),
        (1, Strategy::PredictiveAdaptive, HeardBy::Served, 115_200),
        (1, Strategy::PredictiveAdaptive, HeardBy::Trip, 115_200),
        (0, Strategy::PredictiveAdaptive, HeardBy::Served, 9600),
        (0, Strategy::PredictiveAdaptive, HeardBy::Served, 19_200),
        (0, Strategy::PredictiveAdaptive, HeardBy::Trip, 9600),
        (0, Strategy::Adaptive, HeardBy::Served, 9600),
        (0, Strategy::Adaptive, HeardBy::Trip, 115_200),
    ];
    let seeds = std::env::var("SEEDS").map_or(10, |seeds| seeds.parse().unwrap());
    // Which of them, in which order: `ROWS=5,1`, from 0.
    let rows: Vec<usize> = std::env::var("ROWS").map_or_else(
        |_| (0..all.len()).collect(),
        |rows| rows.split(',').map(|row| row.parse().unwrap()).collect(),
    );
    for what in rows.into_iter().map(|row| &all[row]) {
        let (lens, strategy, by, baud) = what;
        let (name, lens) = &LENSES[*lens];
        let mut floor = 0.0;
        let mut found: Vec<[f64; 8]> = Vec::new();
        for seed in 1..=seeds {
            let scene = scene(lens, *baud, &folder);
            let sensor = sensor(&scene);
            let asked = asked(&scene, *strategy, *by, 80.0);
            floor = floor_s(&asked);
            match run(scene, &sensor, &asked, seed, SensorLineFault::None) {
                Err(refusal) => println!("{name} {strategy:?} {by:?} {baud}: {refusal}"),
                Ok(done) => {
                    let e = errors(&done).unwrap_or([f64::NAN; 3]);
                    let missing = done.places.len() - done.points();
                    let named = done
                        .places
                        .iter()
                        .filter(|p| matches!(p.found.state, PlaceState::NoSignal(_)))
                        .count();
                    found.push([
                        e[0],
                        e[1],
                        e[2],
                        done.duration_s,
                        done.path_mm,
                        done.exchanges as f64,
                        done.exchange_s,
                        missing as f64,
                    ]);
                    println!(
                        "{name} {strategy:?} {by:?} {baud} {seed}: {:.2} {:.2} {:.1}; {:.0} {:.3}; {:.0}; {} {:.0}; {missing} ({named} by name) {}",
                        e[0],
                        e[1],
                        e[2],
                        done.duration_s,
                        done.duration_s / floor,
                        done.path_mm,
                        done.exchanges,
                        done.exchange_s,
                        done.alarm.map_or_else(String::new, |alarm| alarm.message),
                    );
                }
            }
        }
        let n = found.len() as f64;
        print!("{name} {strategy:?} {by:?} {baud}, mean and spread of {n}:");
        for k in 0..8 {
            let mean = found.iter().map(|of| of[k]).sum::<f64>() / n;
            let squares: f64 = found.iter().map(|of| (of[k] - mean).powi(2)).sum();
            let spread = (squares / (n - 1.0).max(1.0)).sqrt();
            print!(" {mean:.3} ({spread:.3})");
        }
        println!();
        let mean = |k: usize| found.iter().map(|of| of[k]).sum::<f64>() / n;
        done_rows.push(Row {
            what: *what,
            rms_um: mean(0),
            seconds: mean(3),
            of_floor: mean(3) / floor,
            missing: mean(7),
        });
    }
    goals(&done_rows, 81.0);
}
