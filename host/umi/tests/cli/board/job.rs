//! `umi job new`, `umi job check`

use serde_json::json;

use crate::rig::run::{Folder, project, umi, umi_reads};

fn example() -> String {
    std::fs::read_to_string(project("examples/three-spheres.toml")).unwrap()
}

/// The example job is good: shown in words, and as JSON with all its fields.
#[test]
fn the_example_is_good() {
    let file = project("examples/three-spheres.toml");
    let text = umi(&["job", "check", &file]).exits(0).out;
    for words in [
        "job THREE SPHERES",
        "SPHERE3",
        "12.7 mm",
        "g10-g68",
        "can be used",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
    let witnessed = project("examples/three-spheres-witnessed.toml");
    let wide = umi(&["job", "check", &witnessed]).exits(0).out;
    for line in wide.lines() {
        assert!(line.chars().count() <= 100, "too wide: {line}");
    }
    let value = umi(&["job", "check", &file, "--json"]).exits(0).json();
    assert_eq!(value["status"], "ok");
    assert_eq!(value["job"]["features"][2]["name"], "SPHERE3");
    assert_eq!(value["job"]["limits"]["tilt_deg"], 0.010);
}

/// What is probed once more, and what stays on the table, is no datum.
#[test]
fn a_closing_ball_is_told_as_one() {
    let file = project("examples/four-spheres.toml");
    let text = umi(&["job", "check", &file]).exits(0).out;
    let row = |name: &str| {
        let mut rows = text
            .lines()
            .filter(|line| line.trim_start().starts_with(name));
        rows.next().unwrap().to_owned()
    };
    assert!(row("SPHERE1").contains("  yes "), "{text}");
    assert!(row("CLOSING4").contains("  closes SPHERE4 "), "{text}");
}

/// The table of guards: the first job to begin with sees what the thesis' one does not, in
/// words at most 79 wide and as JSON.
#[test]
fn a_check_says_what_the_job_sees() {
    let rows = |example: &str| {
        let file = project(example);
        let text = umi(&["job", "check", &file]).exits(0).out;
        let table: Vec<&str> = text
            .lines()
            .skip_while(|line| !line.contains("what may happen"))
            .take_while(|line| !line.is_empty())
            .collect();
        assert!(table.len() > 13, "{text}");
        for line in &table {
            assert!(line.chars().count() <= 79, "too wide: {line}");
        }
        let value = umi(&["job", "check", &file, "--json"]).exits(0).json();
        value["guards"]["rows"].as_array().unwrap().clone()
    };
    let seen = |rows: &[serde_json::Value], code: &str| {
        let row = rows.iter().find(|row| row["code"] == code).unwrap();
        (
            row["seen"].as_str().unwrap().to_owned(),
            row["from_um"].as_f64().unwrap_or(f64::NAN),
        )
    };
    let (four, three) = (
        rows("examples/four-spheres.toml"),
        rows("examples/three-spheres.toml"),
    );
    assert_eq!(four.len(), three.len());
    for code in ["late_text", "stale_read", "silent_teaching", "wrong_digit"] {
        assert_eq!(seen(&four, code).0, "always", "{code}");
        assert_ne!(seen(&three, code).0, "always", "{code}");
    }
    // The closing ball sees what moves while it is probed; three balls alone see less of it.
    assert_eq!(seen(&four, "drift").0, "from");
    assert!(seen(&four, "drift").1 < 20.0);
    assert!(seen(&three, "slip").1 > seen(&four, "slip").1 || seen(&three, "slip").0 == "no");
}

/// Who lacks a place is named; a ball outside the closing pair and another tool length are seen.
#[test]
fn a_check_names_what_lacks_a_place() {
    let four = std::fs::read_to_string(project("examples/four-spheres.toml")).unwrap();
    let folder = Folder::new();
    let without = four.replace("position_mm = [-136.7, 136.4, 136.1]\n", "");
    assert_ne!(without, four);
    let file = folder.file("four.toml", &without);
    let text = umi(&["job", "check", &file]).exits(0).out;
    assert!(text.contains("no `position_mm` at SPHERE3:"), "{text}");
    let value = umi(&["job", "check", &file, "--json"]).exits(0).json();
    assert_eq!(
        value["guards"]["without_place"],
        serde_json::json!(["SPHERE3"])
    );
    let whole = umi(&["job", "check", &folder.file("whole.toml", &four)])
        .exits(0)
        .out;
    assert!(!whole.contains("no `position_mm`"), "{whole}");
    let row = |text: &str, what: &str| {
        let line = text.lines().find(|line| line.contains(what));
        line.unwrap_or_else(|| panic!("no {what} in\n{text}"))
            .to_owned()
    };
    assert!(
        row(&whole, "outside the closing pair").contains("always"),
        "{whole}"
    );
    assert!(
        row(&whole, "another tool length").contains("always"),
        "{whole}"
    );
    let bent = row(&whole, "bent stylus");
    assert!(bent.contains("from 170 mm"), "{bent}");
}

/// A fault is refused with file, line, column, the line itself and what is allowed.
#[test]
fn a_fault_is_shown_in_its_line() {
    let folder = Folder::new();
    let text = example().replace("tilt_deg = 0.010 ", "tilt_deg = -1.0 ");
    let line = text
        .lines()
        .position(|l| l.starts_with("tilt_deg"))
        .unwrap()
        + 1;
    let file = folder.file("bad.toml", &text);
    umi(&["job", "check", &file])
        .exits(2)
        .says(&format!("{file}:{line}:1: "))
        .says("`limits.tilt_deg` cannot be -1")
        .says(&format!("{line} | tilt_deg = -1.0"));
    let error = umi(&["job", "check", &file, "--json"]).exits(2).json()["error"].clone();
    assert_eq!(error["code"], "bad_value");
    assert_eq!(
        (&error["line"], &error["column"]),
        (&line.into(), &1.into())
    );
    assert_eq!(error["file"], *file);
}

/// A misspelt name is refused with the names that there are; also from standard input.
#[test]
fn a_misspelt_name_is_refused_with_those_that_exist() {
    let text = example().replace("hits = 5", "hit = 5");
    let ran = umi_reads(text.as_bytes(), &["job", "check", "-"]).exits(2);
    ran.says("standard input:").says("`hit`").says("`hits`");
}

/// A file that is not there is no refusal: status 1.
#[test]
fn a_missing_job_is_named() {
    umi(&["job", "check", "/nowhere/job.toml"])
        .exits(1)
        .says("/nowhere/job.toml");
}

/// With a measuring machine's sheet, in whatever coordinates, the new job holds the plate's
/// distances also where it is taught; a sheet that cannot be one of four balls is refused.
#[test]
fn a_new_job_holds_the_distances_of_its_sheet() {
    let folder = Folder::new();
    let sheet = |name: &str, fourth: &str| {
        let path = folder.path(name);
        // The plate of the example, turned by a right angle.
        let three = "x,y,z\n136.6,-135,135.9\n134.7,138,110.2\n-136.4,-136.7,136.1\n";
        std::fs::write(&path, format!("{three}{fourth}")).unwrap();
        path
    };
    let taught = |name: &str, fourth: &str| {
        let (sheet, job) = (sheet(name, fourth), folder.path(&format!("{name}.toml")));
        umi(&["job", "new", "--sheet", &sheet, "-o", &job]).exits(0);
        let session = project("examples/four-spheres.txt");
        let told = umi(&["replay", &session, "--job", &job, "--json"]);
        told.out.contains("\"code\":\"nominal_distance\"")
    };
    assert!(!taught("right", "-138.1,137.2,121\n"));
    assert!(taught("wrong", "-138.1,137.26,121\n"));
    let refused = |text: &str| {
        let sheet = folder.path("bad");
        std::fs::write(&sheet, text).unwrap();
        let answer = umi(&["job", "new", "--sheet", &sheet, "--json"]).exits(2);
        answer.json()["error"]["code"].as_str().unwrap().to_owned()
    };
    assert_eq!(refused("0,0,0\n9,0,0\n0,9,0\n"), "ball_count");
    // Its names are those that the control prints, in whatever order they stand.
    let named = |names: [&str; 4]| {
        let places = ["0,0,0", "90,0,0", "0,80,0", "70,70,9"];
        let rows = names.iter().zip(places);
        let rows: String = rows.map(|(name, at)| format!("{name},{at}\n")).collect();
        format!("name,x,y,z\n{rows}")
    };
    let shuffled = folder.path("shuffled");
    std::fs::write(
        &shuffled,
        named(["SPHERE2", "sphere1", "SPHERE4", "SPHERE3"]),
    )
    .unwrap();
    let job = umi(&["job", "new", "--sheet", &shuffled]).exits(0).out;
    let places: Vec<&str> = (job.lines())
        .filter_map(|line| line.strip_prefix("position_mm = ["))
        .filter_map(|rest| rest.split_once(']').map(|(place, _)| place))
        .collect();
    let sorted = [
        "90.0, 0.0, 0.0",
        "0.0, 0.0, 0.0",
        "70.0, 70.0, 9.0",
        "0.0, 80.0, 0.0",
    ];
    assert_eq!(places, sorted);
    let foreign = ["SPHERE2", "SPHERE3", "SPHERE4", "SPHERE5"];
    assert_eq!(refused(&named(foreign)), "ball_names");
    let together = "0,0,0\n90,0,0\n0,80,0\n0,80,0.5\n";
    assert_eq!(refused(together), "balls_together");
    let on_a_line = "0,0,0\n1,0,0\n2,0,0\n3,0,0\n";
    assert_eq!(refused(on_a_line), "degenerate");
}

/// A new job is explicit about teaching and has nothing that is not guarded; it is never written
/// over a file that there is. One that teaches by the first OK setup says what that risks.
#[test]
fn a_new_job_is_explicit() {
    let folder = Folder::new();
    let file = &folder.path("plate.toml");
    umi(&["job", "new", "-o", file]).exits(0);
    let value = umi(&["job", "check", file, "--json"]).exits(0).json();
    assert_eq!(value["job"]["teach"], "asked");
    assert!(value["not_guarded"].is_null(), "{}", value["not_guarded"]);
    umi(&["job", "new", "-o", file]).exits(1).says("plate.toml");
    let text = umi(&["job", "new"]).exits(0).out;
    assert_eq!(std::fs::read_to_string(file).unwrap(), text);

    let old = umi(&[
        "job",
        "check",
        &project("examples/three-spheres.toml"),
        "--json",
    ])
    .exits(0)
    .json();
    assert_eq!(old["not_guarded"]["details"]["first_ok"], true, "{old}");
    let said = umi(&["job", "check", &project("examples/three-spheres.toml")])
        .exits(0)
        .out;
    assert!(
        said.contains("not guarded: text of another clamping"),
        "{said}"
    );
}

/// Repeated hits of each axis become the lines of a job, which takes them, as it takes one number for all;
/// a wrong sigma of one axis is refused by the field's name and at its line.
#[test]
fn a_sigma_of_each_axis() {
    let folder = Folder::new();
    let hits = |name: &str, axis: usize, um: &[f64]| {
        let line = |um: &f64| {
            let mut at = [10.0, 20.0, 30.0];
            at[axis] += um * 1e-3;
            format!("{:.4} {:.4} {:.4}\n", at[0], at[1], at[2])
        };
        folder.file(name, um.iter().map(line).collect::<String>())
    };
    let x = hits("x.csv", 0, &[0.0, 1.0, 2.0, 3.0]);
    let y = hits("y.csv", 1, &[0.0, 2.0, 4.0]);
    let z = hits("z.csv", 2, &[0.0, 6.0, 3.0, 0.0, 6.0]);
    let args = ["job", "probing", "--x", &x, "--y", &y, "--z", &z];
    let value = umi(&[&args[..], &["--json"]].concat()).exits(0).json();
    let told = |at: usize| value["probing"]["sigma_mm"][at].as_f64().unwrap();
    assert!((told(0) - (5.0_f64 / 3.0).sqrt() * 1e-3).abs() < 1e-9);
    assert!((told(1) - 0.002).abs() < 1e-9 && (told(2) - 0.003).abs() < 1e-9);
    assert_eq!(value["probing"]["dof"], 2);
    let said = umi(&args).exits(0).out;
    let (_, lines) = said.split_once("[guards.probing]").unwrap();
    assert!(lines.contains("sigma_mm = [0.001291, 0.002000, 0.003000]\ndof = 2"));

    let job = umi(&["job", "new"]).exits(0).out;
    let with = |sigma: &str| {
        let job = job.replace("sigma_mm = 0.001 ", &format!("sigma_mm = {sigma} "));
        folder.file("plate.toml", &job)
    };
    let sigma = |text: &str| {
        let job = umi(&["job", "check", &with(text), "--json"])
            .exits(0)
            .json();
        job["job"]["guards"]["probing"]["sigma_mm"].clone()
    };
    assert_eq!(sigma("0.001"), json!([0.001, 0.001, 0.001]));
    assert_eq!(sigma("[0.001, 0.001, 0.003]"), json!([0.001, 0.001, 0.003]));
    let said = umi(&["job", "check", &with("[0.001, 0.001, 0.003]")]).exits(0);
    assert!(said.out.contains("0.001, 0.001, 0.003 mm"), "{}", said.out);
    for (wrong, code) in [
        ("[0.001, 0.0, 0.003]", "bad_value"),
        ("[0.001, 0.001, nan]", "bad_value"),
        ("[0.001, 0.001, -0.003]", "bad_value"),
        ("[inf, 0.001, 0.003]", "bad_value"),
        ("0.0", "bad_value"),
        ("[0.001, 0.003]", "job_syntax"),
        ("[0.001, 0.001, 0.001, 0.001]", "job_syntax"),
        ("\"0.001\"", "job_syntax"),
    ] {
        let ran = umi(&["job", "check", &with(wrong), "--json"]).exits(2);
        let error = &ran.json()["error"];
        assert_eq!(error["code"], code, "{wrong}: {error}");
        let said = error["message"].to_string();
        assert!(
            said.contains(if code == "bad_value" {
                "guards.probing"
            } else {
                "three in brackets"
            }),
            "{wrong}: {said}"
        );
    }

    let once = hits("once.csv", 2, &[0.0]);
    let same = hits("same.csv", 2, &[0.0, 0.0]);
    for (z, code) in [
        (&once, "too_few_hits"),
        (&same, "no_scatter"),
        (&x, "no_scatter"),
    ] {
        let ran = umi(&["job", "probing", "--x", &x, "--y", &y, "--z", z, "--json"]).exits(2);
        assert_eq!(ran.json()["error"]["code"], code);
    }
}

/// GRBL has no word that raises an alarm, and no variable for a run: the job says both.
#[test]
fn a_control_without_an_alarm_is_said() {
    let folder = Folder::new();
    let example = std::fs::read_to_string(project("examples/three-spheres.toml")).unwrap();
    let has = |file: &str| {
        let value = umi(&["job", "check", file, "--json"]).exits(0).json();
        assert_eq!(
            value["not_guarded"]["details"]["late_text"], true,
            "{value}"
        );
        value["read_raises_alarm"].clone()
    };
    assert_eq!(has(&project("examples/three-spheres.toml")), true);
    let dialect = example
        .lines()
        .find(|line| line.starts_with("dialect"))
        .unwrap();
    let text = example.replace(dialect, "dialect = \"grbl\"");
    let grbl = folder.file("grbl.toml", text);
    assert_eq!(has(&grbl), false);
    let said = umi(&["job", "check", &grbl]).exits(0).out;
    assert!(
        said.contains("a READ without an OK verdict gets nothing"),
        "{said}"
    );
    assert!(
        said.contains("not guarded: text of another clamping"),
        "{said}"
    );
}

/// What the text tells beside its tables, JSON tells as well: word for word, by a stable name.
#[test]
fn notes_are_told_for_people_and_for_machines() {
    let folder = Folder::new();
    let four = std::fs::read_to_string(project("examples/four-spheres.toml")).unwrap();
    let linuxcnc = four.replace("dialect = \"g10-g68\"", "dialect = \"linuxcnc\"");
    assert_ne!(linuxcnc, four);
    let counted = linuxcnc.replace("run_variable = 531", "run_variable = 4531");
    assert_ne!(linuxcnc, counted);
    let siemens = four
        .replace("dialect = \"g10-g68\"", "dialect = \"siemens\"")
        .replace("ends_with = \"M99\"", "ends_with = \"M30\"");
    let grbl = std::fs::read_to_string(project("examples/three-spheres.toml")).unwrap();
    let dialect = grbl
        .lines()
        .find(|line| line.starts_with("dialect"))
        .unwrap();
    let grbl = grbl.replace(dialect, "dialect = \"grbl\"");
    for (name, job, codes) in [
        (
            "seven bits",
            format!("{four}\n[line]\ndata_bits = 7\n"),
            &["parity_sees_half", "frame_limits"][..],
        ),
        (
            "main",
            four.replace("ends_with = \"M99\"", "ends_with = \"M30\""),
            &["end_takes_the_turn", "frame_limits"],
        ),
        ("four", four.clone(), &["frame_limits"]),
        (
            "linuxcnc",
            linuxcnc,
            &["other_run_variable", "frame_limits"],
        ),
        ("counted", counted, &["frame_limits"]),
        ("siemens", siemens, &["run_counted_by_you", "frame_limits"]),
        ("grbl", grbl, &["read_gets_nothing", "not_guarded"]),
    ] {
        let file = folder.file(&format!("{name}.toml"), job);
        let value = umi(&["job", "check", &file, "--json"]).exits(0).json();
        let notes = value["notes"].as_array().unwrap();
        let told: Vec<&str> = notes
            .iter()
            .map(|note| note["code"].as_str().unwrap())
            .collect();
        assert_eq!(told, codes, "{name}");
        let text = umi(&["job", "check", &file]).exits(0).out;
        let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        for note in notes {
            let message = note["message"].as_str().unwrap();
            assert!(
                words(&text).contains(&words(message)),
                "{name}: {message}\n{text}"
            );
        }
    }
}

/// A job that does not say `teach` teaches when asked; a capture, of which nobody can ask, is
/// replayed with the first OK setup, and that is said.
#[test]
fn a_job_that_does_not_say_teach() {
    let folder = Folder::new();
    let example = std::fs::read_to_string(project("examples/three-spheres.toml")).unwrap();
    let mute = example.lines().filter(|line| !line.starts_with("teach"));
    let mute = folder.file("mute.toml", mute.collect::<Vec<_>>().join("\n"));
    let value = umi(&["job", "check", &mute, "--json"]).exits(0).json();
    assert_eq!(value["job"]["teach"], "asked");
    assert_eq!(
        value["not_guarded"]["details"]["first_ok"], false,
        "{value}"
    );
    let session = project("examples/session.txt");
    let replay = |job: &str| umi(&["replay", &session, "--job", job, "--json"]).exits(0);
    let ran = replay(&mute).says("does not say `teach`");
    let said = replay(&project("examples/three-spheres.toml"));
    assert_eq!(ran.out, said.out);
    assert_eq!(said.err, "");
}

/// A capture of which a job reads nothing: what was seen, and what to do.
#[test]
fn a_replay_of_another_format_is_not_mute() {
    let (session, job) = (
        project("examples/session.txt"),
        project("examples/four-spheres.toml"),
    );
    umi(&["replay", &session, "--job", &job])
        .exits(0)
        .says("nothing measured: 135 lines, 75 of them points of blocks")
        .says("examples/three-spheres.toml");
}
