//! By what a program is carried: a verdict that stands, of a part that was probed in the work
//! offset in which the program runs, and a transform that is one.

use crate::rig::run::{Folder, Ran, project, umi};

const HEAD: &str = "O7\nG21 G90 G17\n";

/// What a replay prints of a capture, with this job.
fn replayed(folder: &Folder, capture: &str, job: &str) -> String {
    let (capture, job) = (folder.file("c.txt", capture), folder.file("j.toml", job));
    umi(&["replay", &capture, "--job", &job, "--json"])
        .exits(0)
        .out
}

fn session() -> String {
    std::fs::read_to_string(project("tests/reference/sessions/session_a.txt")).unwrap()
}

fn job() -> String {
    std::fs::read_to_string(project("examples/three-spheres.toml")).unwrap()
}

fn error(ran: &Ran) -> String {
    ran.json()["error"]["code"].as_str().unwrap().to_owned()
}

/// The part was probed in G54. A program that runs in another offset is refused, or carried by the
/// origins of both, and `nc diff` calls no other one the image.
#[test]
fn a_program_runs_where_the_part_was_probed() {
    let folder = Folder::new();
    let verdicts = folder.file("v.jsonl", replayed(&folder, &session(), &job()));
    let out = folder.path("out.nc");
    let program = |offset: &str| {
        let text = format!("{HEAD}{offset}\nG0 X10. Y0. Z5.\nG1 X60. F100\nM30\n");
        folder.file("p.nc", text)
    };
    let rewrite = |offset: &str, more: &[&str]| {
        let program = program(offset);
        let args = [
            "nc",
            "rewrite",
            &program,
            "-o",
            &out,
            "--force",
            "--verdict",
            &verdicts,
        ];
        umi(&[&args[..], more].concat())
    };
    rewrite("G54", &[]).exits(0);
    rewrite("(NONE)", &[]).exits(0);
    for offset in ["G55", "G56", "G54.1 P3"] {
        std::fs::remove_file(&out).unwrap();
        rewrite(offset, &[])
            .exits(2)
            .says("line 4, column 4: how this work offset lies to the one that was probed")
            .says("probed in G54");
        assert!(!std::path::Path::new(&out).exists(), "{offset}");
        umi(&["nc", "check", &program(offset), "--verdict", &verdicts]).exits(2);
        rewrite("G54", &[]).exits(0);
        // The program of G54 is no image of this one.
        umi(&["nc", "diff", &program(offset), &out, "--verdict", &verdicts]).exits(2);
    }
    // A program that moves the offset is carried from where that was.
    rewrite("G10 L2 P1 X5.", &[]).exits(0);
    for (offset, status) in [("G10 L2 P1 X5.", 0), ("G54", 2)] {
        let program = program(offset);
        umi(&["nc", "diff", &program, &out, "--verdict", &verdicts]).exits(status);
    }
    // The job says where G54 is: with G55's origin the program is carried, and compared.
    let origin = ["--origin", "G55=-300,-250,-310"];
    rewrite("G55", &origin).exits(0);
    let diff = [
        &["nc", "diff", &program("G55"), &out, "--verdict", &verdicts],
        &origin[..],
    ];
    umi(&diff.concat()).exits(0);
    let other = ["--origin", "G54=1,2,3"];
    rewrite("G55", &[&origin[..], &other].concat())
        .exits(1)
        .says("by the job's `probed_origin_mm`");
    rewrite("G55", &[&origin[..], &["--origin", "G55=1,2,3"]].concat()).exits(1);
    rewrite("G54", &["--probed-in", "G51"])
        .exits(1)
        .says("give G54 to G59");
    rewrite("G55", &["--probed-in", "G55"])
        .exits(1)
        .says("was probed in G54");
    // Of another job the same program is the right one.
    let elsewhere = job().replace("probed_in = \"G54\"", "probed_in = \"G56\"");
    let verdicts = folder.file("v2.jsonl", replayed(&folder, &session(), &elsewhere));
    for (offset, status) in [("G54", 2), ("G56", 0)] {
        let args = ["nc", "rewrite", &program(offset), "-o", &out, "--force"];
        umi(&[&args[..], &["--verdict", &verdicts]].concat()).exits(status);
    }
    // A correction is reckoned in the offset that was probed.
    let plan = folder.file("j.toml", job());
    umi(&["correction", "--verdict", &verdicts, "--job", &plan])
        .exits(1)
        .says("was probed in G56");
}

/// What a replay printed corrects by its last verdict only up to its end, and only if nothing came
/// behind that.
#[test]
fn a_printed_verdict_stands_at_the_end() {
    let folder = Folder::new();
    let program = folder.file("p.nc", format!("{HEAD}G0 X10. Y0. Z5.\nM30\n"));
    let job = job();
    let run = |printed: &str| {
        let printed = folder.file("v.jsonl", printed);
        let out = folder.path("out.nc");
        let args = ["nc", "rewrite", &program, "-o", &out, "--force", "--json"];
        umi(&[&args[..], &["--verdict", &printed]].concat())
    };
    let whole = replayed(&folder, &session(), &job);
    run(&whole).exits(0);
    let lines: Vec<&str> = whole.split_inclusive('\n').collect();
    for length in 1..lines.len() {
        let cut = lines[..length].concat();
        let ran = run(&cut);
        let has_verdict = cut.contains("\"type\":\"verdict\"");
        let ran = ran.exits(if has_verdict { 2 } else { 1 });
        let expected = if has_verdict
            && !lines[..length]
                .iter()
                .rfind(|line| line.contains("\"type\":\"verdict\""))
                .unwrap()
                .contains("\"verdict\":\"OK\"")
        {
            "not_ok"
        } else if has_verdict {
            "no_end"
        } else {
            "verdict"
        };
        assert_eq!(error(&ran), expected, "{length} lines");
    }
    // Something else was printed.
    let begun = format!("{}PART 7\n", session());
    let ran = run(&replayed(&folder, &begun, &job)).exits(2);
    assert_eq!(error(&ran), "taken_back");
    // One verdict alone is somebody's choice.
    let alone = lines
        .iter()
        .rfind(|line| line.contains("\"verdict\":\"OK\""))
        .unwrap();
    run(alone).exits(0);
    let twice = alone.replacen(
        "\"verdict\":\"OK\"",
        "\"verdict\":\"NG\",\"verdict\":\"OK\"",
        1,
    );
    let said = run(&twice).exits(1).json()["error"]["message"].to_string();
    assert!(said.contains("duplicate field"), "{said}");
    run(&alone.replacen("\"reasons\":[]", "\"reasons\":\"rms\"", 1)).exits(1);
}

/// A transform that is none, of a registration that is none, and of a pose that is NG, corrects
/// nothing.
#[test]
fn a_transform_is_one() {
    let folder = Folder::new();
    let job = folder.file("j.toml", job());
    let out = folder.path("out.nc");
    let program = folder.file("p.nc", format!("{HEAD}G0 X10. Y0. Z5.\nM30\n"));
    let both = |transform: &str| {
        let transform = folder.file("t.json", transform);
        let correction = [
            "correction",
            "--transform",
            &transform,
            "--job",
            &job,
            "--json",
        ];
        let rewrite = ["nc", "rewrite", &program, "-o", &out, "--force", "--json"];
        [
            umi(&correction),
            umi(&[&rewrite[..], &["--transform", &transform]].concat()),
        ]
    };
    let turned = |c: f64, s: f64| {
        format!(
            "{{\"rotation\": [[{c},{}, 0],[{s},{c},0],[0,0,1]], \"translation_mm\": [1,2,0]}}",
            -s
        )
    };
    let (sin, cos) = 1_f64.to_radians().sin_cos();
    for ran in both(&turned(cos, sin)) {
        ran.exits(0);
    }
    for ran in both(&turned(1.0, 0.017)) {
        let said = ran.exits(1).json()["error"]["message"].to_string();
        assert!(said.contains("orthogonal"), "{said}");
    }
    let nominal = "x,y,z\n0,0,0\n100,0,0\n0,80,0\n20,30,40\n";
    let nominal = folder.file("p.csv", nominal);
    for (measured, says) in [
        (
            "0,0,0\n0,3.937,0\n-3.1496,0,0\n-1.1811,0.7874,1.5748\n",
            "inches",
        ),
        (
            "0,0,0\n0,120,0\n-96,0,0\n-36,24,48\n",
            "1.2000 times as far apart",
        ),
        ("0,0,0\n0,100,0\n-80,0,0\n-30,20,-40\n", "mirror image"),
        (
            "0,100,0\n0,0,0\n-80,0,0\n-30,20,40\n",
            "in the order 2 1 3 4",
        ),
        ("0,0,0\n0,100,0\n-80,0,0\n-30,25,41\n", "rms"),
    ] {
        let measured = folder.file("q.csv", format!("x,y,z\n{measured}"));
        umi(&["register", &nominal, &measured]).exits(0).says(says);
        let made = umi(&["register", &nominal, &measured, "--json"])
            .exits(0)
            .out;
        for ran in both(&made) {
            assert_eq!(error(&ran.exits(2)), "not_ok", "{says}");
        }
    }
    let named = |order: [&str; 4]| {
        let rows = ["0,0,0", "100,0,0", "0,80,0", "20,30,40"]
            .into_iter()
            .zip(order);
        let rows: Vec<String> = rows.map(|(at, name)| format!("{name},{at}\n")).collect();
        format!("name,x,y,z\n{}", rows.concat())
    };
    let [by_name, other] = [
        folder.file("n.csv", named(["A", "B", "C", "D"])),
        folder.file("m.csv", named(["A", "C", "B", "D"])),
    ];
    umi(&["register", &by_name, &by_name]).exits(0);
    let differ = umi(&["register", &by_name, &other, "--json"]).exits(1);
    assert_eq!(error(&differ), "names_differ");
    let twice = folder.file("t.csv", named(["A", "A", "B", "C"]));
    let twice = umi(&["register", &twice, &twice, "--json"]).exits(1);
    assert_eq!(error(&twice), "name_twice");
    let measured = folder.file("q.csv", "x,y,z\n1,0,0\n1,100,0\n-79,0,0\n-29,20,40.02\n");
    let good = umi(&["register", &nominal, &measured, "--json"]).exits(0);
    assert!(good.json()["suspect"].is_null());
    let [_, carried] = both(&good.out);
    carried.exits(0);
    // Of points that disagree, as by a chip on one: no more than `umi correction` takes.
    let chip = folder.file("c.csv", "x,y,z\n1,0,0\n1,100,0\n-79,0,0.4\n-29,20,40\n");
    let chip = umi(&["register", &nominal, &chip, "--json"]).exits(0);
    assert!(chip.json()["suspect"].is_null());
    for refused in both(&chip.out) {
        assert_eq!(error(&refused.exits(2)), "expected_error");
    }
    // As well known as that at its points, and a part reaches farther: the covariance says how well there.
    let near = folder.file("near.csv", "x,y,z\n0,0,0\n10,0,0\n0,8,0\n2,3,4\n");
    let found = folder.file("f.csv", "x,y,z\n1,0,0\n1,10.003,0\n-7,0,0.003\n-2,2,4\n");
    let near = umi(&["register", &near, &found, "--json"]).exits(0);
    assert!(near.json()["suspect"].is_null());
    for reaches in both(&near.out) {
        reaches.exits(0);
    }
    let far = folder.file("far.nc", format!("{HEAD}G0 X300. Y0. Z5.\nM30\n"));
    let made = folder.file("near.json", &near.out);
    let far = |more: &[&str]| {
        let rewrite = [
            "nc",
            "rewrite",
            &far,
            "-o",
            &out,
            "--force",
            "--json",
            "--transform",
            &made,
        ];
        umi(&[&rewrite[..], more].concat())
    };
    let wide = [
        "correction",
        "--transform",
        &made,
        "--job",
        &job,
        "--json",
        "--part-max",
        "300,200,100",
    ];
    assert_eq!(error(&umi(&wide).exits(2)), "expected_error");
    assert_eq!(error(&far(&[]).exits(2)), "expected_error");
    far(&["--limit", "0.5"]).exits(0);
    // A square whose list begins at another corner fits as well, and turns the part by a quarter.
    let square = ["0,0,0", "100,0,0", "100,100,0", "0,100,0"];
    let of = |places: [&str; 4]| format!("x,y,z\n{}\n", places.join("\n"));
    let [a, b, c, d] = square;
    let [straight, shifted] = [
        folder.file("s.csv", of(square)),
        folder.file("r.csv", of([b, c, d, a])),
    ];
    let good = umi(&["register", &straight, &straight, "--json"]).exits(0);
    assert!(good.json()["suspect"].is_null());
    let turned = umi(&["register", &straight, &shifted, "--json"]);
    let turned = turned.exits(0).says("column `name`").out;
    for refused in both(&turned) {
        assert_eq!(error(&refused.exits(2)), "not_ok");
    }
    // Whoever wrote it: a tool would come from below.
    let over = r#"{"rotation": [[-1,0,0],[0,1,0],[0,0,-1]], "translation_mm": [0,0,0]}"#;
    for refused in both(over) {
        assert_eq!(error(&refused.exits(2)), "upside_down");
    }
}

/// Two programs that cut elsewhere are not the same where an axis was never named, stands where the
/// machine has sent it, or blocks and lengths depend on the control; and those that do not differ are
/// the same there, moved or not.
#[test]
fn what_is_not_at_a_place_of_the_part_is_compared() {
    let folder = Folder::new();
    let begin = "O7\nG90 G21 G17 G54 G94\nG0 X0. Y0. Z10.\n";
    let flat = "O7\nG90 G21 G17 G54 G94\nG0 X0. Y0.\n";
    let compared = |a: &str, b: &str| {
        let [a, b] = [("a.nc", a), ("b.nc", b)].map(|(name, text)| folder.file(name, text));
        umi(&["nc", "diff", &a, &b])
    };
    let steps = |n: usize| format!("G91\n{}", "G1 X0.04 F100\n".repeat(n));
    let (fifty, less) = (steps(50), steps(49));
    for (head, a, b) in [
        (flat, "G1 X10. F100\nY10.\nX0.", "G1 X99. F100\nY-77.\nX0."),
        (
            begin,
            "G53 G0 Z-50.\nG1 X50. Y50. F100\nG0 X5. Y5. Z10.",
            "G53 G0 Z-50.\nG1 X-50. Y70. F100\nG0 X5. Y5. Z10.",
        ),
        (
            begin,
            "G91 G28 Z0\nG90 G0 X0. Y0.\nG1 X10. F100\nZ5.",
            "G91 G28 Z0\nG90 G0 X0. Y0.\nG1 X99. F100\nX10.\nZ5.",
        ),
        (begin, "G1 X20. F1\nX0.", "/G1 X20. F1\nX0."),
        (begin, "/G1 X20. F1\nX0.", "/G1 X20. F1\n/X0."),
        (begin, "G1 X20. F1", "G1 X20. F1\n/M30\nX50."),
        (begin, "G43 H1 Z5.\nG1 X9. F9", "G43 H2 Z5.\nG1 X9. F9"),
        (begin, "G43 H1 Z5.\nG1 X9. F9", "G44 H1 Z5.\nG1 X9. F9"),
        (begin, "G43 H1 Z5.\nG1 X9. F9", "Z5.\nG1 X9. F9"),
        (begin, "IF[#500EQ1]GOTO9\nG1 X9. F9\nN9", "G1 X9. F9\nN9"),
        (begin, &fifty, &less),
    ] {
        let [a, b] = [a, b].map(|body| format!("{head}{body}\nM30\n"));
        compared(&a, &a).exits(0);
        compared(&b, &b).exits(0);
        let said = compared(&a, &b).exits(2).out;
        assert!(said.contains("different"), "{b}\n{said}");
        let said = compared(&b, &a).exits(2).out;
        assert!(said.contains("different"), "{b}\n{said}");
    }
    // Rewritten, a program that goes on below what the machine has sent away is its image, and no
    // other one is.
    let level = "{\"rotation\": [[0,-1,0],[1,0,0],[0,0,1]], \"translation_mm\": [3,4,0.5]}";
    let transform = folder.file("t.json", level);
    let body = "G1 X10. F100\nG2 X20. Y10. R10.\nG91 G28 Z0\nG90 G0 X0. Y5.\nM30\n";
    let first = folder.file("c.nc", format!("{begin}{body}"));
    let out = folder.path("out.nc");
    umi(&[
        "nc",
        "rewrite",
        &first,
        "-o",
        &out,
        "--transform",
        &transform,
    ])
    .exits(0);
    let image = |second: &str| umi(&["nc", "diff", &first, second, "--transform", &transform]);
    let said = image(&out).exits(0).out;
    assert!(said.contains("same"), "{said}");
    let text = std::fs::read_to_string(&out).unwrap();
    let moved = text.replace("X-2. Y4.", "X-2. Y4.1");
    assert_ne!(moved, text, "{text}");
    image(&folder.file("d.nc", moved)).exits(2);
    // Where the part leans, what the machine has sent away would move the others.
    let leans = "{\"rotation\": [[0.8,0,0.6],[0,1,0],[-0.6,0,0.8]], \"translation_mm\": [0,0,0]}";
    let leans = folder.file("l.json", leans);
    let cuts = folder.file("e.nc", format!("{flat}G1 X10. F100\nM30\n"));
    let said = umi(&["nc", "diff", &cuts, &cuts, "--transform", &leans])
        .exits(2)
        .out;
    assert!(said.contains("not compared: the cut in line 4"), "{said}");
}

/// A transform leads from the part into the coordinates of the work offset. Where a scanner stands
/// moves no part; of a scan somebody says whose coordinates it has; the machine's are reckoned from
/// the offset's origin.
#[test]
fn a_transform_says_whose_coordinates_it_leads_to() {
    let folder = Folder::new();
    let stands = job().replace(
        "[0.0, 0.0, 0.0]   # G54",
        "[-400.0, -250.0, -310.0]   # G54",
    );
    let job = folder.file("j.toml", stands);
    let out = folder.path("out.nc");
    let program = folder.file("p.nc", format!("{HEAD}G0 X10. Y0. Z5.\nM30\n"));
    let made = |frames: &str, shift: [f64; 3], more: &[&str]| {
        let (sin, cos) = 0.5_f64.to_radians().sin_cos();
        let [x, y, z] = shift;
        let text = format!(
            "{{\"rotation\": [[{cos},{},0],[{sin},{cos},0],[0,0,1]], \"translation_mm\": [{x},{y},{z}]{frames}}}",
            -sin
        );
        let transform = folder.file("t.json", text);
        let correction = [
            "correction",
            "--transform",
            &transform,
            "--job",
            &job,
            "--json",
        ];
        let rewrite = ["nc", "rewrite", &program, "-o", &out, "--force", "--json"];
        let more = [&rewrite[..], &["--transform", &transform], more].concat();
        [umi(&correction), umi(&more)]
    };
    let into = |from: &str, to: &str| {
        format!(", \"from\": \"{from}\", \"to\": \"{to}\", \"verdict\": \"OK\"")
    };
    let shift = [1.5, -2.0, 0.25];
    for (from, to, code) in [
        ("scanner", "machine", "not_of_a_part"),
        ("part", "scan", "frame_unknown"),
    ] {
        for ran in made(&into(from, to), shift, &[]) {
            assert_eq!(error(&ran.exits(2)), code);
        }
    }
    let motions = || {
        let text = std::fs::read_to_string(&out).unwrap();
        text.lines()
            .filter(|line| line.starts_with('G'))
            .collect::<String>()
    };
    let [wanted, rewritten] = made(&into("part", "offset"), shift, &[]);
    let wanted = wanted.exits(0).json()["text"].clone();
    rewritten.exits(0);
    let carried = motions();
    // As the job has it.
    let origin = [-400.0, -250.0, -310.0];
    let on_machine: [f64; 3] = std::array::from_fn(|axis| shift[axis] + origin[axis]);
    let frames = into("part", "machine");
    let [corrected, rewritten] = made(&frames, on_machine, &[]);
    assert_eq!(corrected.exits(0).json()["text"], wanted);
    assert_eq!(error(&rewritten.exits(1)), "machine_frame");
    let place = ["--probed-in", "G54", "--origin", "G54=-400,-250,-310"];
    let [_, rewritten] = made(&frames, on_machine, &place);
    rewritten.exits(0);
    assert_eq!(motions(), carried);
}

/// Points of a work offset and the same points of the machine correct alike; a registration whose points
/// disagree by more than may be left corrects nothing.
#[test]
fn a_registration_says_whose_coordinates_it_leads_to() {
    let folder = Folder::new();
    let stands = job().replace(
        "[0.0, 0.0, 0.0]   # G54",
        "[-400.0, -250.0, -310.0]   # G54",
    );
    let job = folder.file("j.toml", stands);
    let nominal = [
        [0.0, 0.0, 0.0],
        [120.0, 0.0, 5.0],
        [0.0, 80.0, -3.0],
        [110.0, 75.0, 20.0],
    ];
    let list = |points: [[f64; 3]; 4]| -> String {
        let row = |[x, y, z]: [f64; 3]| format!("{x},{y},{z}\n");
        ["x,y,z\n".to_owned()]
            .into_iter()
            .chain(points.map(row))
            .collect()
    };
    let given = folder.file("nominal.csv", list(nominal));
    let corrected = |name: &str, move_by: [f64; 3], off_mm: f64, more: &[&str]| {
        let mut points = nominal.map(|[x, y, z]| [x + move_by[0], y + move_by[1], z + move_by[2]]);
        points[3][2] += off_mm;
        let measured = folder.file(name, list(points));
        let register = [&["register", &given, &measured, "--json"][..], more].concat();
        let transform = folder.file("t.json", umi(&register).exits(0).out);
        umi(&[
            "correction",
            "--transform",
            &transform,
            "--job",
            &job,
            "--json",
        ])
    };
    let (shift, on_machine) = ([1.5, -2.0, 0.25], [-398.5, -252.0, -309.75]);
    let wanted = corrected("offset.csv", shift, 0.0, &[]).exits(0).json();
    let machine = ["--measured-in", "machine"];
    let same = corrected("machine.csv", on_machine, 0.0, &machine).exits(0);
    assert_eq!(same.json()["text"], wanted["text"]);
    assert!(
        wanted["text"]
            .as_str()
            .unwrap()
            .contains("G10 L2 P2 X-398.5")
    );
    let off = corrected("off.csv", shift, 0.1, &[]).exits(2).json();
    assert_eq!(off["error"]["code"], "expected_error");
}

/// A correction of a verdict is reckoned from where its part was probed, and from nowhere else.
#[test]
fn a_correction_is_reckoned_from_where_the_part_was_probed() {
    let folder = Folder::new();
    let verdicts = folder.file("v.jsonl", replayed(&folder, &session(), &job()));
    let same = folder.file("j.toml", job());
    let correct = |job: &str, more: &[&str]| {
        umi(&[
            &["correction", "--verdict", &verdicts, "--job", job][..],
            more,
        ]
        .concat())
    };
    correct(&same, &[]).exits(0);
    correct(&same, &["--origin", "100,200,-300"])
        .exits(1)
        .says("was probed where G54 was at");
    let moved = job().replace("probed_origin_mm = [", "probed_origin_mm = [7");
    assert_ne!(moved, job());
    correct(&folder.file("k.toml", moved), &[]).exits(1);
}

/// Two programs that move otherwise, if a variable has another value, in another offset, or over
/// another place, are not the same.
#[test]
fn a_difference_that_hides_is_found() {
    let folder = Folder::new();
    let body = "G54\nG0 X10. Y0. Z5.\nG1 X60. F100\nG91 G28 Z0\nG90 G0 X0 Y0 Z50.\nM30\n";
    let first = folder.file("a.nc", format!("{HEAD}{body}"));
    let compared = |text: &str| {
        let second = folder.file("b.nc", format!("{HEAD}{text}"));
        umi(&["nc", "diff", &first, &second])
    };
    compared(body).exits(0);
    for (from, to) in [
        ("G91 G28 Z0", "G91 G28 Z-60."),
        ("G91 G28 Z0", "G90 G28 Z0"),
        ("G91 G28 Z0", "G91 G30 Z0"),
        ("G54\n", "G55\n"),
        ("G54\n", "G54.1 P3\n"),
        ("G1 X60.", "G55 G1 X60."),
        ("G1 X60.", "IF[#500EQ1]GOTO99\nG1 X60."),
        ("G90 G0 X0 ", "G90 G0 X0 Z#500\nX0 "),
        ("G1 X60. F100", "G1 X[60.+#500] F100"),
        ("G1 X60. F100", "G1 X60. F100\n#500=1."),
    ] {
        assert!(body.contains(from));
        compared(&body.replacen(from, to, 1)).exits(2);
    }
    let carries = "IF[#500EQ1]GOTO99\nG54\n";
    let both = folder.file("c.nc", format!("{HEAD}{carries}N99{body}"));
    umi(&["nc", "diff", &both, &both]).exits(0);
}
