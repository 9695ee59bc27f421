//! `umi scan demo`: the figures, in words and as JSON.

use crate::rig::run::umi;

#[test]
fn the_demonstration_meets_its_goals() {
    let ran = umi(&["scan", "demo", "--runs", "1", "--seed", "7", "--json"]).exits(0);
    let value = ran.json();
    assert_eq!(value["ok"], true);
    assert_eq!(value["seeds"], serde_json::json!([7]));
    let printed = &value["washer"][1]["printed_error_mm"][0];
    assert!((printed.as_f64().unwrap() + 1.08).abs() < 1e-9);
    for row in value["washer"].as_array().unwrap() {
        let errors = row["largest_error_mm"].as_array().unwrap();
        for (error, goal) in errors.iter().zip([0.02, 0.02, 0.005]) {
            // Above 0: it was measured, not written.
            assert!((1e-6..goal).contains(&error.as_f64().unwrap()), "{row}");
        }
    }
    for row in value["speed"].as_array().unwrap() {
        let speed = row["speed_mm_per_s"].as_f64().unwrap();
        let timer = row["with_timer_mm"].as_f64().unwrap();
        assert!((timer + speed * 0.055).abs() < 0.002, "{row}");
        assert!(
            row["with_board_mm"].as_f64().unwrap().abs() < 0.002,
            "{row}"
        );
    }
    let again = umi(&["scan", "demo", "--runs", "1", "--seed", "7", "--json"]).exits(0);
    assert_eq!(again.out, ran.out);
    let text = umi(&["scan", "demo", "--runs", "1", "--seed", "8"])
        .exits(0)
        .out;
    for words in [
        "40.85",
        "-0.35",
        "-1.08",
        "printed, off",
        "within the goals",
        "WITHOUT noise",
        "+500",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
}

/// The thesis' workpiece: the board's scan adds the sensor's noise alone; the loop's adds what the
/// machine has moved meanwhile, on the slopes of the arc.
#[test]
fn the_workpiece_is_scanned_in_three_ways() {
    let ran = umi(&[
        "scan",
        "demo",
        "--workpiece",
        "--runs",
        "1",
        "--seed",
        "3",
        "--json",
    ]);
    let found = ran.exits(0).json();
    let of = |scan: &str, name: &str| {
        let scans = found["scans"].as_array().unwrap();
        let row = scans
            .iter()
            .find(|row| row["scan"].as_str().unwrap().starts_with(scan));
        row.unwrap()[name].as_f64().unwrap()
    };
    let [board, old, roland] = ["Gocator, board", "Gocator, software loop", "Roland"];
    assert!(
        of(board, "points") > 300_000.0 && of(roland, "points") > 2000.0,
        "{found}"
    );
    assert!(
        (0.008..0.012).contains(&of(board, "scan_rms_mm")),
        "{found}"
    );
    assert!(
        of(old, "scan_rms_mm") > 1.3 * of(board, "scan_rms_mm"),
        "{found}"
    );
    assert!(
        (0.02..0.035).contains(&of(roland, "scan_rms_mm")),
        "{found}"
    );
    assert!(of(board, "std_mm") < of(old, "std_mm"), "{found}");
    assert!(of(board, "mean_above_mm") > 0.0 && of(board, "mean_below_mm") < 0.0);
    assert_eq!(found["scans"][0]["printed"]["std_mm"], 0.021);
    assert_eq!(found["scans"][1]["printed"]["mean_below_mm"], -0.022);
}
