//! `umi scan demo`: the figures, in words and as JSON.

use crate::rig::run::{Folder, umi};

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
    // The tables stand in the text and on the page, with the spread over the seeds.
    let folder = Folder::new();
    let page = folder.path("demo.html");
    let two = [
        "scan", "demo", "--runs", "2", "--seed", "8", "--report", &page,
    ];
    let text = umi(&two).exits(0).out;
    let html = std::fs::read_to_string(&page).unwrap();
    for table in 11..=16 {
        let caption = format!("Table {table}: ");
        assert!(
            text.contains(&caption) && html.contains(&caption),
            "{caption}"
        );
    }
    assert!(!html.contains("NaN") && !html.contains("src="));
    for words in [
        "2 seeds, 8 to 9",
        "0.45",
        "1.53",
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

/// Of two seeds the spread is that of the two runs by themselves: mean, standard deviation, and the one farther off.
#[test]
fn the_spread_over_seeds_is_that_of_the_runs() {
    let run = |seed: &str, runs: &str| {
        let args = ["scan", "demo", "--runs", runs, "--seed", seed, "--json"];
        umi(&args).exits(0).json()
    };
    let (one, other, both) = (run("8", "1"), run("9", "1"), run("8", "2"));
    let true_mm = [41.20, 19.75, 6.30];
    for (test, row) in both["washer"].as_array().unwrap().iter().enumerate() {
        for (i, truth) in true_mm.into_iter().enumerate() {
            let of = |run: &serde_json::Value| run["washer"][test]["mean_mm"][i].as_f64().unwrap();
            let (a, b) = (of(&one), of(&other));
            let spread = |name: &str| row["spread"][i][name].as_f64().unwrap();
            assert!((spread("mean") - f64::midpoint(a, b)).abs() < 1e-12);
            assert!((spread("std") - (a - b).abs() / 2.0_f64.sqrt()).abs() < 1e-12);
            let worst = if (a - truth).abs() > (b - truth).abs() {
                a
            } else {
                b
            };
            assert!((spread("worst") - worst).abs() < 1e-12);
            let largest = row["largest_error_mm"][i].as_f64().unwrap();
            assert!((largest - (worst - truth).abs()).abs() < 1e-12);
        }
    }
    assert!(one["ball"]["spread"]["std"].is_null(), "{one}");
}

/// The thesis' workpiece: the board's scan adds the sensor's noise alone; the loop's adds what the
/// machine has moved meanwhile, on the slopes of the arc.
#[test]
fn the_workpiece_is_scanned_in_three_ways() {
    let folder = Folder::new();
    let page = folder.path("part.html");
    let ran = umi(&[
        "scan",
        "demo",
        "--workpiece",
        "--runs",
        "1",
        "--seed",
        "3",
        "--json",
        "--report",
        &page,
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
    // Table 6.1 is the scene's; of table 6.2 each error stands alone, and together they are what a scan adds.
    assert_eq!(
        found["table_6_1"][1]["here_mm"],
        serde_json::json!([0.044, 0.075])
    );
    let budget = found["table_6_2"].as_array().unwrap();
    let z = |row: usize| budget[row]["z_rms_mm"]["mean"].as_f64().unwrap();
    let [scales, delay, sensor, with_loop, with_board] = [0, 1, 2, 3, 4].map(z);
    assert!((1e-5..0.002).contains(&scales), "{found}");
    assert!(delay > 5.0 * scales && sensor > 5.0 * scales, "{found}");
    // 55 ms are 137.5 um at 2.5 mm/s.
    let along = budget[1]["along_mm"]["worst"].as_f64().unwrap();
    assert!((0.13..0.1376).contains(&along), "{found}");
    assert!(
        (with_loop - delay.hypot(sensor)).abs() < 0.1 * with_loop,
        "{found}"
    );
    assert!((with_board - sensor).abs() < 0.1 * with_board, "{found}");
    assert!(
        budget[0]["z_rms_mm"]["std"].is_null(),
        "one seed has no spread"
    );
    let html = std::fs::read_to_string(&page).unwrap();
    for shown in [
        "Table 5.1",
        "Table 6.1",
        "Table 6.2",
        "Table 6.3",
        "From above",
        "seed 3",
    ] {
        assert!(html.contains(shown), "{shown}");
    }
    // Points stand there in base 64: any three letters may.
    assert!(!html.contains(">NaN") && !html.contains("src=\""));
}
