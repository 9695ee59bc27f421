//! `umi scan` against the reference cases, whose answers were computed with 40 digits, and
//! against input that must be refused.

use std::path::PathBuf;

use serde_json::{Value, json};

use crate::rig::run::{Folder, Ran, command, project, umi};

/// The folder of the cases.
fn cases() -> PathBuf {
    PathBuf::from(project("tests/reference/scan"))
}

fn read(name: &str) -> Value {
    let text = std::fs::read_to_string(cases().join(name)).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// Runs a command in the folder of the cases, with `--json`.
fn run(args: &[String]) -> Ran {
    let args: Vec<&str> = args.iter().map(String::as_str).chain(["--json"]).collect();
    let output = command(&args).current_dir(cases()).output().unwrap();
    Ran {
        status: output.status.code().unwrap(),
        out: String::from_utf8(output.stdout).unwrap(),
        err: String::from_utf8(output.stderr).unwrap(),
    }
}

/// All numbers of a value, in order.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(all) => all.iter().flat_map(numbers).collect(),
        Value::Number(number) => vec![number.as_f64().unwrap()],
        other => panic!("no number: {other}"),
    }
}

/// The largest difference between two values of the same shape.
fn apart(a: &Value, b: &Value) -> f64 {
    let (a, b) = (numbers(a), numbers(b));
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(&b)
        .fold(0.0, |most, (a, b)| most.max((a - b).abs()))
}

#[track_caller]
fn close(id: &str, name: &str, got: &Value, expected: &Value, tolerance: f64) {
    let apart = apart(got, expected);
    assert!(
        apart <= tolerance,
        "{id}: {name} is {apart:e} off, {tolerance:e} allowed"
    );
}

/// Relative to the largest number of the expected.
#[track_caller]
fn close_rel(id: &str, name: &str, got: &Value, expected: &Value, tolerance: f64) {
    let largest = numbers(expected)
        .iter()
        .fold(0.0_f64, |m, v| m.max(v.abs()));
    close(id, name, got, expected, tolerance * largest);
}

/// The numbers of a CSV file below its first line.
fn csv(path: &std::path::Path) -> Value {
    let text = std::fs::read_to_string(path).unwrap();
    let cells = text.lines().skip(1).flat_map(|line| line.split(','));
    cells
        .map(|cell| Value::from(cell.parse::<f64>().unwrap()))
        .collect()
}

fn check(id: &str, kind: &str, case: &Value, got: &Value, out: &str) {
    let (answer, tol) = (&case["answer"], &case["tol"]);
    let tolerance = |name: &str| tol[name].as_f64().unwrap();
    let same = |names: &[&str]| {
        for name in names {
            if !answer[*name].is_null() {
                assert_eq!(got[*name], answer[*name], "{id}: {name}");
            }
        }
    };
    match kind {
        "pose" => {
            let (all, expected) = (&got["poses"], &answer["poses"]);
            assert_eq!(
                all.as_array().unwrap().len(),
                expected.as_array().unwrap().len()
            );
            for (got, expected) in all
                .as_array()
                .unwrap()
                .iter()
                .zip(expected.as_array().unwrap())
            {
                for name in ["rotation", "translation_mm"] {
                    close(id, name, &got[name], &expected[name], tolerance(name));
                }
            }
        }
        "pair" | "merge" => {
            same(&[
                "unpaired_profiles",
                "duplicates",
                "unpaired_triggers",
                "lost_frames",
                "missed_latches",
                "profiles",
                "paired",
                "points",
                "invalid",
            ]);
            if answer["pairs"].is_array() {
                let pair = |p: &Value| {
                    Value::from(vec![
                        p["profile"].clone(),
                        p["frame"].clone(),
                        p["number"].clone(),
                    ])
                };
                let pairs: Value = got["pairs"].as_array().unwrap().iter().map(pair).collect();
                assert_eq!(pairs, answer["pairs"], "{id}: pairs");
                let drift = &got["clock"]["drift_ppm"];
                close(
                    id,
                    "drift",
                    drift,
                    &answer["drift_ppm"],
                    tolerance("drift_ppm"),
                );
            }
            if let Some(points) = answer["points_csv"].as_str() {
                let mm = tolerance("point_mm");
                for end in ["min", "max"] {
                    close(
                        id,
                        end,
                        &got["bounds_mm"][end],
                        &answer["bounds_mm"][end],
                        mm,
                    );
                }
                let written = csv(&PathBuf::from(format!("{out}.csv")));
                close(id, "points", &written, &csv(&cases().join(points)), mm);
            }
        }
        "calibrate" => {
            same(&["n", "dof"]);
            for name in ["rotation", "translation_mm"] {
                close(id, name, &got[name], &answer[name], tolerance(name));
            }
            let unit = "covariance_unit";
            close_rel(
                id,
                unit,
                &got[unit],
                &answer[unit],
                tolerance("covariance_rel"),
            );
            if !answer["sigma_mm"].is_null() {
                let sigma = "sigma_mm";
                close_rel(
                    id,
                    sigma,
                    &got[sigma],
                    &answer[sigma],
                    tolerance("sigma_rel"),
                );
                let all = "covariance";
                close_rel(
                    id,
                    all,
                    &got[all],
                    &answer[all],
                    tolerance("covariance_rel"),
                );
            }
        }
        "axis" => {
            same(&["n", "dof"]);
            for name in ["direction", "point_mm"] {
                close(id, name, &got[name], &answer[name], tolerance(name));
            }
            for name in ["cov_direction_unit", "cov_point_unit"] {
                close_rel(
                    id,
                    name,
                    &got[name],
                    &answer[name],
                    tolerance("covariance_rel"),
                );
            }
            let sigma = "sigma_mm";
            close_rel(
                id,
                sigma,
                &got[sigma],
                &answer[sigma],
                tolerance("sigma_rel"),
            );
        }
        "compare" => {
            for (name, expected) in answer.as_object().unwrap() {
                close(id, name, &got[name], expected, tolerance("mm"));
            }
        }
        other => panic!("{id}: {other} is no kind"),
    }
}

#[test]
fn every_reference_case_is_answered_or_refused_as_it_must_be() {
    let folder = Folder::new();
    let index = read("index.json");
    let index = index.as_array().unwrap();
    assert!(index.len() >= 15);
    for entry in index {
        let id = entry["id"].as_str().unwrap();
        let case = read(&format!("{id}.json"));
        let out = folder.path(id);
        let args = case["command"].as_array().unwrap().iter();
        let args: Vec<String> = args
            .map(|arg| arg.as_str().unwrap().replace("{out}", &out))
            .collect();
        let ran = run(&args);
        if case["expect"] == "refused" {
            let error = &ran.exits(2).json()["error"];
            assert!(
                case["error_any_of"]
                    .as_array()
                    .unwrap()
                    .contains(&error["code"]),
                "{id}: {error}"
            );
            if !case["free"].is_null() {
                assert_eq!(error["free"], case["free"], "{id}");
            }
            continue;
        }
        let got = ran.exits(0).json();
        check(id, entry["kind"].as_str().unwrap(), &case, &got, &out);
    }
}

/// A scan that is refused leaves no file, and the one that was there stays as it was.
#[test]
fn a_refused_merge_writes_nothing() {
    let folder = Folder::new();
    let out = folder.path("cloud.ply");
    std::fs::write(&out, "old").unwrap();
    let args = [
        "scan",
        "merge",
        "pair_ambiguous.profiles.csv",
        "pair_ambiguous.triggers.csv",
        "--machine",
        "merge_3axis.toml",
        "--force",
        "-o",
        &out,
    ];
    let ran = run(&args.map(str::to_owned));
    // The table has no counts of Y and Z.
    assert_eq!(ran.exits(2).json()["error"]["code"], "missing_axis");
    assert_eq!(std::fs::read(&out).unwrap(), b"old");
    assert!(!PathBuf::from(format!("{out}.part")).exists());
}

/// Behind a loss of motion counts are wrong: nothing of it becomes a point.
#[test]
fn what_lies_behind_a_loss_of_motion_is_refused() {
    let folder = Folder::new();
    let table = std::fs::read_to_string(cases().join("merge_3axis.triggers.csv")).unwrap();
    let mut lines: Vec<String> = table.lines().map(|line| format!("{line},")).collect();
    lines[0] += "what";
    let good: Vec<&str> = lines[10].split(',').collect();
    let (number, t_ns): (u64, &str) = (good[1].parse().unwrap(), good[3]);
    let row = format!("loss,,,{t_ns},,,,,,,,,,4,transitions");
    assert_eq!(row.matches(',').count(), lines[1].matches(',').count());
    lines.push(row);
    let table = folder.file("triggers.csv", lines.join("\n") + "\n");
    let out = folder.path("cloud.csv");
    let merge = |more: &[&str]| {
        let args = ["scan", "merge", "merge_3axis.profiles.csv", &table];
        let args = [&args, &["--machine", "merge_3axis.toml", "-o", &out], more].concat();
        run(&args.iter().map(|arg| (*arg).to_owned()).collect::<Vec<_>>())
    };
    let error = merge(&[]).exits(2).json();
    assert_eq!(error["error"]["code"], "motion_lost", "{error}");
    assert!(!PathBuf::from(&out).exists());
    let merged = merge(&["--until-loss"]).exits(0).json();
    let paired = merged["paired"].as_u64().unwrap();
    assert!(paired > 0 && paired <= number + 1, "{merged}");
    assert!(merged["points"].as_u64().unwrap() < 879);
    // What is used and what is left out, once each.
    assert_eq!(merged["pairs"].as_array().unwrap().len() as u64, paired);
    let numbers = |name: &str| -> Vec<u64> {
        let all = merged[name].as_array().unwrap().iter();
        all.map(|number| number.as_u64().unwrap()).collect()
    };
    let pairs = merged["pairs"].as_array().unwrap().iter();
    let used: Vec<u64> = pairs.map(|p| p["profile"].as_u64().unwrap()).collect();
    let behind = numbers("behind_loss");
    assert!(!behind.is_empty() && behind.iter().all(|profile| !used.contains(profile)));
    let all = used.len() + behind.len() + numbers("unpaired_profiles").len();
    let all = all + numbers("duplicates").len();
    assert_eq!(all as u64, merged["profiles"].as_u64().unwrap(), "{merged}");
    let warnings = merged["warnings"].to_string();
    assert!(warnings.contains("motion_lost"), "{merged}");
    // What the sensor saw behind the last right latch: nobody knows where, whatever the latches say behind the loss.
    let late = merge(&["--until-loss", "--latency-us", "30", "--force"])
        .exits(0)
        .json();
    assert_eq!(late["paired"].as_u64().unwrap(), paired - 1, "{late}");
    let early = merge(&["--until-loss", "--latency-us=-30", "--force"])
        .exits(0)
        .json();
    assert_eq!(early["paired"].as_u64().unwrap(), paired, "{early}");
    // Lost before the first latch: nothing is right, with --until-loss neither.
    let first_ns = lines[1].split(',').nth(3).unwrap();
    let early: u64 = first_ns.parse::<u64>().unwrap() - 1;
    let last = lines.len() - 1;
    lines[last] = format!("loss,,,{early},,,,,,,,,,4,transitions");
    let lost = folder.file("lost.csv", lines.join("\n") + "\n");
    for more in [&[][..], &["--until-loss"]] {
        let none = folder.path("none.csv");
        let args = ["scan", "merge", "merge_3axis.profiles.csv", &lost];
        let args = [&args, &["--machine", "merge_3axis.toml", "-o", &none], more].concat();
        let error = run(&args.iter().map(|arg| (*arg).to_owned()).collect::<Vec<_>>());
        let error = error.exits(2).json();
        assert_eq!(error["error"]["code"], "motion_lost", "{error}");
        assert!(error.to_string().contains("no profile has"), "{error}");
        assert!(!PathBuf::from(&none).exists());
    }
    let strict = [
        "scan",
        "pair",
        "merge_3axis.profiles.csv",
        &table,
        "--strict",
    ];
    let strict = run(&strict.map(str::to_owned)).exits(2).json();
    assert_eq!(strict["error"]["code"], "faults", "{strict}");
    assert!(strict.to_string().contains("loss of motion"), "{strict}");
}

/// A PLY with profiles keeps what filters by profile and meshes need; without, they say how to get it.
#[test]
fn a_ply_keeps_profile_and_index_where_they_are_asked_for() {
    let folder = Folder::new();
    let merge = |name: &str, more: &[&str]| {
        let out = folder.path(name);
        let args = ["scan", "merge", "merge_3axis.profiles.csv"];
        let args = [&args[..], &["merge_3axis.triggers.csv", "-o", &out]].concat();
        let args = [&args[..], &["--machine", "merge_3axis.toml"], more].concat();
        let ran = run(&args.iter().map(|arg| (*arg).to_owned()).collect::<Vec<_>>());
        (out, ran)
    };
    let (bare, ran) = merge("bare.ply", &[]);
    let plain = ran.exits(0).json();
    let (kept, ran) = merge("kept.ply", &["--profiles-too"]);
    assert_eq!(ran.exits(0).json()["points"], plain["points"]);
    let filtered = folder.path("filtered.ply");
    let filter = |cloud: &str| {
        let args = ["scan", "filter", cloud, "--spike", "1", "-o", &filtered];
        run(&args.map(str::to_owned))
    };
    let error = filter(&bare).exits(2).json();
    assert_eq!(error["error"]["code"], "no_profiles", "{error}");
    assert!(error.to_string().contains("--profiles-too"), "{error}");
    filter(&kept).exits(0);
    // Each point as the table has it.
    let (table, ran) = merge("table.csv", &[]);
    ran.exits(0);
    let again = folder.path("again.csv");
    let args = ["scan", "convert", &kept, "-o", &again];
    run(&args.map(str::to_owned)).exits(0);
    let ids = |path: &str| -> Vec<String> {
        let text = std::fs::read_to_string(path).unwrap();
        let rows = text.lines().skip(1);
        let ids = rows.map(|row| row.splitn(3, ',').take(2).collect::<Vec<_>>().join(","));
        ids.collect()
    };
    assert_eq!(ids(&table), ids(&again));
    let (_, ran) = merge("none.las", &["--profiles-too"]);
    assert_eq!(ran.exits(1).json()["error"]["code"], "format");
}

/// The time of a point is that of its latch and the latency, in every format that a cloud can be read back from.
#[test]
fn points_keep_their_time_where_it_is_asked_for() {
    let folder = Folder::new();
    let id = "merge_5axis_latency";
    let latency_us = 137.0;
    let merge = |name: &str, more: &[&str]| {
        let out = folder.path(name);
        let (profiles, triggers) = (format!("{id}.profiles.csv"), format!("{id}.triggers.csv"));
        let machine = format!("{id}.toml");
        let args = ["scan", "merge", &profiles, &triggers, "-o", &out];
        let args = [
            &args[..],
            &["--machine", &machine, "--latency-us", "137"],
            more,
        ]
        .concat();
        let ran = run(&args.iter().map(|arg| (*arg).to_owned()).collect::<Vec<_>>());
        (out, ran)
    };
    let columns = |path: &str, names: &[&str]| -> Vec<Vec<f64>> {
        let text = std::fs::read_to_string(path).unwrap();
        let mut lines = text.lines();
        let head: Vec<&str> = lines.next().unwrap().split(',').collect();
        let places = names.iter().map(|n| {
            head.iter()
                .position(|h| h == n)
                .unwrap_or_else(|| panic!("{n} in {path}"))
        });
        let places: Vec<usize> = places.collect();
        let row = |line: &str| {
            let cells: Vec<&str> = line.split(',').collect();
            places
                .iter()
                .map(|&k| cells[k].parse().unwrap_or(f64::NAN))
                .collect()
        };
        lines.map(row).collect()
    };
    let (table, ran) = merge("table.csv", &["--times-too"]);
    let merged = ran.exits(0).json();
    let text = std::fs::read_to_string(&table).unwrap();
    assert!(text.starts_with("profile,index,x_mm,y_mm,z_mm,t_us\n"));
    // By the board's own table.
    let latches = cases().join(format!("{id}.triggers.csv"));
    let latches = columns(latches.to_str().unwrap(), &["number", "t_ns"]);
    let of_profile = |profile: f64| {
        let pairs = merged["pairs"].as_array().unwrap();
        let pair = pairs
            .iter()
            .find(|p| p["profile"] == profile as u64)
            .unwrap();
        let number = pair["number"].as_f64().unwrap();
        latches.iter().find(|l| l[0] == number).unwrap()[1] / 1e3 + latency_us
    };
    let wanted = columns(&table, &["profile", "t_us"]);
    assert_eq!(wanted.len() as u64, merged["points"]);
    for row in &wanted {
        assert!((row[1] - of_profile(row[0])).abs() < 1e-6, "{row:?}");
    }
    assert!(wanted.iter().any(|row| row[1] != wanted[0][1]));
    // Without the option no column comes, and other formats have the same times.
    let (bare, ran) = merge("bare.csv", &[]);
    ran.exits(0);
    let text = std::fs::read_to_string(&bare).unwrap();
    assert!(text.starts_with("profile,index,x_mm,y_mm,z_mm\n"));
    for name in ["a.ply", "a.pcd", "a.las", "a.laz", "a.e57"] {
        let (cloud, ran) = merge(name, &["--times-too"]);
        ran.exits(0);
        let again = folder.path(&format!("{name}.csv"));
        let args = ["scan", "convert", &cloud, "-o", &again];
        run(&args.map(str::to_owned)).exits(0);
        let found = columns(&again, &["t_us"]);
        assert_eq!(found.len(), wanted.len(), "{name}");
        for (found, wanted) in found.iter().zip(&wanted) {
            assert!(
                (found[0] - wanted[1]).abs() < 1e-6,
                "{name}: {found:?} {wanted:?}"
            );
        }
    }
    let (_, ran) = merge("each.e57", &["--times-too", "--each-profile"]);
    assert_eq!(ran.status, 1);
}

/// A sensor whose counter starts anew in the scan while its clock goes on: what is left out is named, and on demand
/// every profile has the latch that it has by the clocks.
#[test]
fn a_frame_counter_that_starts_anew_is_named_or_followed() {
    let folder = Folder::new();
    let text = std::fs::read_to_string(cases().join("pair_clean.profiles.csv")).unwrap();
    let mut lines = text.lines();
    let mut anew = format!("{}\n", lines.next().unwrap());
    let half = 40;
    let mut first = None;
    for line in lines {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        let (profile, frame): (u64, u64) = (cells[0].parse().unwrap(), cells[1].parse().unwrap());
        let first = *first.get_or_insert(frame);
        if profile >= half {
            cells[1] = (frame - half).max(first).to_string();
        }
        anew += &(cells.join(",") + "\n");
    }
    let anew = folder.file("anew.csv", anew);
    let pair = |profiles: &str, more: &[&str]| {
        let args = ["scan", "pair", profiles, "pair_clean.triggers.csv"];
        let args = [&args[..], more].concat();
        run(&args.iter().map(|arg| (*arg).to_owned()).collect::<Vec<_>>())
    };
    let latches = |answer: &Value| -> Vec<(Value, Value)> {
        let pairs = answer["pairs"].as_array().unwrap();
        let pairs = pairs
            .iter()
            .map(|p| (p["profile"].clone(), p["number"].clone()));
        pairs.collect()
    };
    let clean = pair("pair_clean.profiles.csv", &[]).exits(0).json();
    assert!(clean.get("restarts").is_none() && clean.get("renumbered").is_none());
    let named = pair(&anew, &[]).exits(0).json();
    let left_out = named["renumbered"].as_array().unwrap().len();
    assert!(left_out >= 40, "{named}");
    assert_eq!(named["duplicates"], named["renumbered"]);
    let warning = named["warnings"].to_string();
    assert!(
        warning.contains("frame_counter") && warning.contains("--counter-restarts"),
        "{warning}"
    );
    let followed = pair(&anew, &["--counter-restarts"]).exits(0).json();
    assert_eq!(latches(&followed), latches(&clean));
    assert_eq!(followed["restarts"], serde_json::json!([half]));
    assert!(followed.get("renumbered").is_none());
    let strict = pair(&anew, &["--counter-restarts", "--strict"])
        .exits(2)
        .json();
    assert!(
        strict.to_string().contains("1 restarts of the counter"),
        "{strict}"
    );
}

/// A table of positions without a position has no pose to answer.
#[test]
fn no_positions_are_no_poses() {
    let folder = Folder::new();
    let none = folder.file("none.csv", "X,Y,Z\n");
    let args = ["scan", "pose", "merge_3axis.toml", &none];
    let error = run(&args.map(str::to_owned)).exits(2).json();
    assert_eq!(error["error"]["code"], "no_positions", "{error}");
}

/// Bounds that nothing lies between would drop every point.
/// Each point keeps the intensity of its own sample, in every format that a cloud can be read back from, and `filter`
/// goes by it. Without the option the cloud is the same to the byte as that of profiles without the column.
#[test]
fn points_keep_their_intensity_where_it_is_asked_for() {
    let folder = Folder::new();
    let bright = |profile: usize, index: usize| (37 * profile + 11 * index) % 251;
    let plain = std::fs::read_to_string(cases().join("merge_3axis.profiles.csv")).unwrap();
    let head = "profile,frame,t_us,encoder,index,x_mm,z_mm";
    assert_eq!(plain.lines().next(), Some(head));
    let mut text = format!("{head},intensity\n");
    for row in plain.lines().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        let of_row = match cells[4].parse() {
            Ok(index) => bright(cells[0].parse().unwrap(), index).to_string(),
            Err(_) => String::new(),
        };
        text += &format!("{row},{of_row}\n");
    }
    let with = folder.file("profiles.csv", &text);
    let merge = |profiles: &str, name: &str, more: &[&str]| {
        let out = folder.path(name);
        let args = ["scan", "merge", profiles, "merge_3axis.triggers.csv"];
        let out_args = ["--machine", "merge_3axis.toml", "-o", &out];
        let args = [&args[..], &out_args, more].concat();
        let ran = run(&args.iter().map(|arg| (*arg).to_owned()).collect::<Vec<_>>());
        (out, ran)
    };
    // Nobody asked: as ever.
    for name in ["a.csv", "a.ply"] {
        let (bare, ran) = merge("merge_3axis.profiles.csv", name, &[]);
        let answer = ran.exits(0).json();
        let (beside, ran) = merge(&with, &format!("b{name}"), &[]);
        assert_eq!(ran.exits(0).json(), answer);
        assert!(std::fs::read(&bare).unwrap() == std::fs::read(&beside).unwrap());
    }
    let (table, ran) = merge(&with, "table.csv", &["--intensity-too"]);
    let merged = ran.exits(0).json();
    let text = std::fs::read_to_string(&table).unwrap();
    assert!(text.starts_with("profile,index,x_mm,y_mm,z_mm,intensity\n"));
    let whole = |cell: &str| cell.parse::<f64>().unwrap() as usize;
    let wanted: Vec<usize> = (text.lines().skip(1))
        .map(|row| {
            let cells: Vec<&str> = row.split(',').collect();
            assert_eq!(
                whole(cells[5]),
                bright(whole(cells[0]), whole(cells[1])),
                "{row}"
            );
            whole(cells[5])
        })
        .collect();
    assert_eq!(wanted.len() as u64, merged["points"]);
    assert!(wanted.iter().any(|b| *b > 125) && wanted.iter().any(|b| *b <= 125));
    for name in ["c.ply", "c.pcd", "c.las", "c.laz", "c.e57"] {
        let (cloud, ran) = merge(&with, name, &["--intensity-too"]);
        ran.exits(0);
        let again = folder.path(&format!("{name}.csv"));
        let args = ["scan", "convert", &cloud, "-o", &again];
        run(&args.map(str::to_owned)).exits(0);
        let text = std::fs::read_to_string(&again).unwrap();
        assert!(
            text.lines().next().unwrap().ends_with(",intensity"),
            "{name}"
        );
        let found = text
            .lines()
            .skip(1)
            .map(|row| whole(row.rsplit(',').next().unwrap()));
        assert_eq!(found.collect::<Vec<_>>(), wanted, "{name}");
    }
    let (cloud, out) = (folder.path("c.ply"), folder.path("filtered.csv"));
    let gone = folder.path("gone.csv");
    let args = [
        "scan",
        "filter",
        &cloud,
        "--intensity",
        "0,125",
        "-o",
        &out,
        "--dropped",
        &gone,
    ];
    let filtered = run(&args.map(str::to_owned)).exits(0).json();
    let kept = wanted.iter().filter(|b| **b <= 125).count();
    assert_eq!(filtered["kept"], kept as u64);
    let text = std::fs::read_to_string(&gone).unwrap();
    assert_eq!(text.lines().count(), 1 + wanted.len() - kept);
    for row in text.lines().skip(1) {
        assert!(whole(row.rsplit(',').next().unwrap()) > 125, "{row}");
    }
    // What has none is refused, and leaves no file.
    let (out, ran) = merge("merge_3axis.profiles.csv", "none.csv", &["--intensity-too"]);
    let error = ran.exits(2).json();
    assert_eq!(error["error"]["code"], "no_intensity", "{error}");
    assert!(!std::path::Path::new(&out).exists());
}

#[test]
fn an_intensity_with_its_bounds_reversed_is_refused() {
    let folder = Folder::new();
    let cloud = folder.file("cloud.csv", "x,y,z,intensity\n1,2,3,100\n");
    let out = folder.path("out.csv");
    let filter = |bounds: &str| {
        let args = ["scan", "filter", &cloud, "--intensity", bounds, "-o", &out];
        run(&args.map(str::to_owned))
    };
    let refused = filter("200,20");
    let refused = refused.exits(1).json();
    assert_eq!(refused["error"]["code"], "usage");
    assert!(refused.to_string().contains("20,200"), "{refused}");
    assert!(!PathBuf::from(&out).exists());
    filter("20,200").exits(0);
}

/// A capture that is cut anywhere within a message, or whose sizes make no sense, is told so.
#[test]
fn a_capture_that_is_cut_or_damaged_is_not_understood() {
    let folder = Folder::new();
    let whole = std::fs::read(cases().join("merge_gocator.gocator")).unwrap();
    let path = folder.path("cut.gocator");
    for (bytes, code) in [
        (whole[..whole.len() - 1].to_vec(), "truncated"),
        (whole[..75].to_vec(), "truncated"),
        ([&[3, 0, 0, 0, 1, 0], &whole[..]].concat(), "corrupt"),
        (
            [&[255, 255, 255, 255, 1, 0], &whole[..]].concat(),
            "corrupt",
        ),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let args = ["scan", "pair", &path, "merge_gocator.triggers.csv"];
        let ran = run(&args.map(str::to_owned));
        assert_eq!(ran.exits(1).json()["error"]["code"], code);
    }
}

/// Floats and doubles of one scan, read back by the tool itself.
#[test]
fn a_cloud_as_ply_is_the_cloud_as_csv() {
    let folder = Folder::new();
    let nominal = folder.file(
        "nominal.toml",
        "kind = \"sphere\"\ncenter_mm = [0, 0, 0]\nradius_mm = 1.0\n",
    );
    let mut figures = Vec::new();
    for (name, double) in [("a.csv", false), ("b.ply", false), ("c.ply", true)] {
        let out = folder.path(name);
        let mut args = [
            "scan",
            "merge",
            "merge_gocator.gocator",
            "merge_gocator.triggers.csv",
            "--machine",
            "merge_gocator.toml",
            "-o",
            &out,
        ]
        .map(str::to_owned)
        .to_vec();
        if double {
            args.push("--double".into());
        }
        run(&args).exits(0);
        let args = ["scan", "compare", &out, "--nominal", &nominal].map(str::to_owned);
        let found = run(&args).exits(0).json();
        figures.push(["mean_mm", "std_mm", "max_mm"].map(|name| found[name].as_f64().unwrap()));
    }
    for i in 0..3 {
        assert!((figures[0][i] - figures[1][i]).abs() < 1e-4, "{figures:?}");
        assert!((figures[0][i] - figures[2][i]).abs() < 1e-11, "{figures:?}");
    }
}

/// A path that was planned holds when it is verified, and its program goes to its rows, to the
/// three digits that it prints.
#[test]
fn a_planned_path_holds_and_its_program_goes_to_its_rows() {
    let folder = Folder::new();
    let part = project("tests/reference/plan/three_axes.obj");
    let spec = project("tests/reference/plan/three_axes.toml");
    let (path, program) = (folder.path("path.csv"), folder.path("path.nc"));
    let pages = folder.path("report/of plan");
    let planned = umi(&[
        "scan",
        "plan",
        &part,
        "--spec",
        &spec,
        "-o",
        &path,
        "--nc",
        &program,
        "--dialect",
        "linuxcnc",
        "--report",
        &pages,
        "--json",
    ]);
    let planned = planned.exits(0).json();
    let verified = umi(&["scan", "verify", &part, "--spec", &spec, &path, "--json"]);
    let verified = verified.exits(0).json();
    assert_eq!(verified["holds"], true, "{verified}");
    for name in ["passes", "poses", "coverage"] {
        assert_eq!(verified[name], planned[name], "{name}");
    }
    // Where more overlap is wanted than the path has, that is told by name.
    let more = std::fs::read_to_string(&spec).unwrap();
    let more = folder.file("more.toml", more.replace("overlap = 0.15", "overlap = 0.5"));
    let verify = ["scan", "verify", &part, "--spec", &more, &path];
    let wanting = umi(&[&verify[..], &["--json"]].concat()).exits(0).json();
    assert_eq!(wanting["holds"], false);
    assert_eq!(wanting["faults"][0]["fault"], "overlap", "{wanting}");
    assert_eq!(wanting["faults"][1], serde_json::Value::Null);
    assert_eq!(wanting["overlap"]["wanted"], 0.5);
    let told = umi(&verify).exits(0).out;
    assert!(told.contains("broken (overlap)"), "{told}");

    let page = std::fs::read_to_string(format!("{pages}/plan.html")).unwrap();
    let seen = 100.0 * planned["coverage"].as_f64().unwrap();
    for text in [
        format!("{seen:.1} % of the surface is seen"),
        "From above".to_owned(),
        "The surface laid flat".to_owned(),
        "S, \u{b0}".to_owned(),
    ] {
        assert!(page.contains(&text), "{text}");
    }
    let picture = std::fs::read_to_string(format!("{pages}/plan.svg")).unwrap();
    assert!(picture.starts_with("<?xml") && picture.trim_end().ends_with("</svg>"));

    let rows = std::fs::read_to_string(&path).unwrap();
    let rows = rows.lines().skip(1).map(|row| -> Vec<f64> {
        let fields = row.split(',').skip(11);
        fields.map(|field| field.parse().unwrap()).collect()
    });
    let program = std::fs::read_to_string(&program).unwrap();
    let blocks = program.lines().filter(|block| block.starts_with("G1 "));
    let blocks = blocks.map(|block| -> Vec<f64> {
        let words = block.split(' ').skip(1).take(4);
        words.map(|word| word[1..].parse().unwrap()).collect()
    });
    let (rows, blocks): (Vec<_>, Vec<_>) = (rows.collect(), blocks.collect());
    assert_eq!(rows.len(), blocks.len());
    assert_eq!(planned["poses"], rows.len());
    for (row, block) in rows.iter().zip(&blocks) {
        for (wanted, printed) in row.iter().zip(block) {
            assert!((wanted - printed).abs() < 0.000_501, "{row:?} {block:?}");
        }
    }
}

/// A block that lies 2 mm below all sides of its raw part: the stock is 2 mm, what needs more
/// is NG by name and exit status, and the transform is written for the commands that follow.
#[test]
fn the_stock_of_a_block_is_what_was_left_on_it() {
    let folder = Folder::new();
    let size = [60.0, 40.0, 20.0];
    let (mut facets, mut points) = (String::from("solid block\n"), String::from("x,y,z\n"));
    for axis in 0..3 {
        for side in [0.0, 1.0] {
            let at = |u: f64, v: f64, off: f64| {
                let mut p = [0.0; 3];
                p[axis] = size[axis] * side + off * (2.0 * side - 1.0);
                p[(axis + 1) % 3] = size[(axis + 1) % 3] * u;
                p[(axis + 2) % 3] = size[(axis + 2) % 3] * v;
                p
            };
            let mut square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
            if side == 0.0 {
                square.reverse();
            }
            for corners in [[0, 1, 2], [0, 2, 3]] {
                facets.push_str("facet normal 0 0 0\nouter loop\n");
                for [u, v] in corners.map(|corner| square[corner]) {
                    let [x, y, z] = at(u, v, 0.0);
                    facets.push_str(&format!("vertex {x} {y} {z}\n"));
                }
                facets.push_str("endloop\nendfacet\n");
            }
            for step in 0..100 {
                let (u, v) = (f64::from(step % 10) / 9.0, f64::from(step / 10) / 9.0);
                let [x, y, z] = at(u, v, 2.0);
                points.push_str(&format!("{x},{y},{z}\n"));
            }
        }
    }
    facets.push_str("endsolid block\n");
    points.push_str("nan,nan,nan\n");
    // Without one of its sides.
    let open = facets
        .split_inclusive("endfacet\n")
        .skip(2)
        .collect::<String>();
    let (part, raw, open) = (
        folder.file("part.stl", facets),
        folder.file("raw.csv", points),
        folder.file("open.stl", format!("solid open\n{open}")),
    );
    let moved = folder.path("moved.json");
    let stock = |need: &str| {
        umi(&[
            "scan",
            "stock",
            &part,
            &raw,
            "--force",
            "--require",
            need,
            "-o",
            &moved,
            "--json",
        ])
    };
    let enough = stock("1.5").exits(0).json();
    assert_eq!(enough["verdict"], "OK", "{enough}");
    let counts = ["n", "n_used", "not_finite"].map(|name| &enough[name]);
    assert_eq!(counts, [601, 600, 1], "{enough}");
    assert!(
        (enough["min_mm"].as_f64().unwrap() - 2.0).abs() < 1e-6,
        "{enough}"
    );
    let written: Value = serde_json::from_str(&std::fs::read_to_string(&moved).unwrap()).unwrap();
    assert_eq!(written["rotation"], enough["rotation"]);

    let page = folder.path("stock.html");
    let asked = ["--objective", "min", "--report", &page];
    let said = umi(&[&["scan", "stock", &part, &raw][..], &asked].concat()).exits(0);
    let page = std::fs::read_to_string(&page).unwrap();
    assert!(said.out.starts_with("OK\n"), "{}", said.out);
    assert!(said.out.contains("1 not finite"), "{}", said.out);
    for words in [
        "OK: least stock 2.",
        "Content-Security-Policy",
        "From above",
        "scan from part",
    ] {
        assert!(page.contains(words), "no {words:?} on the page");
    }
    let found = umi(&["scan", "stock", &open, &raw, "--json"]).json();
    let warnings = found["warnings"].to_string();
    assert!(warnings.contains("open_mesh"), "{found}");
    let scarce = stock("2.5").exits(2).json();
    assert_eq!(scarce["verdict"], "NG");
    assert_eq!(scarce["reasons"][0]["code"], "too_little_stock", "{scarce}");
}

#[test]
fn a_new_machine_file_answers_as_one_object_and_wrong_inputs_are_refused() {
    let folder = Folder::new();
    let told = umi(&["scan", "machine", "new", "mill", "--json"])
        .exits(0)
        .json();
    let text = told["text"].as_str().unwrap();
    assert_eq!(
        (told["kind"].as_str(), told["preset"].as_str()),
        (Some("machine_new"), Some("mill"))
    );
    let mill = folder.path("mill.toml");
    let told = umi(&["scan", "machine", "new", "mill", "-o", &mill, "--json"])
        .exits(0)
        .json();
    assert_eq!(told["output"], json!(mill));
    assert_eq!(std::fs::read_to_string(&mill).unwrap(), text);

    // One input for two axes across each other is a slip; along each other it is a gantry's.
    let joint = |name: &str, direction: &str| {
        format!(
            "[[joint]]\nname = \"{name}\"\nkind = \"linear\"\ndirection = {direction}\ncolumn = \"x\"\n\
             counts_per_mm = 200.0\norigin_counts = 0\n"
        )
    };
    for (direction, status) in [("[0.0, 1.0, 0.0]", 2), ("[-1.0, 0.0, 0.0]", 0)] {
        let joints = joint("X", "[1.0, 0.0, 0.0]") + &joint("U", direction);
        let text = joints + "[chain]\nsensor = [\"X\", \"U\"]\nworkpiece = []\n";
        let file = folder.file("two.toml", text);
        let told = umi(&["scan", "machine", "check", &file, "--json"])
            .exits(status)
            .json();
        if status == 2 {
            assert_eq!(told["error"]["code"], "machine");
            assert!(
                told["error"]["message"]
                    .as_str()
                    .unwrap()
                    .contains("one input, x"),
                "{told}"
            );
        }
    }
}
