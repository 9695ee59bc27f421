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
        "+500",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
}
