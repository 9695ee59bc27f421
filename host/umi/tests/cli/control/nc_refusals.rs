//! `umi nc`: what a program's text alone shows to be wrong is refused by name, and each refusal
//! names the option that allows it.

use crate::rig::run::{Folder, project, umi};

const QUARTER: &str =
    r#"{"rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "translation_mm": [1, 0, 0]}"#;
const LEAN: &str =
    r#"{"rotation": [[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]], "translation_mm": [1, 2, 3]}"#;

const CALLER: &str =
    "%\nO7\nG21 G90 G54\nG0 X10. Y0. Z5.\nM98 P9010\nG90 G0 X20. Y0. Z5.\nM30\n%\n";
const CALLED: &str = "%\nO9010\nG91 G1 X3. F100\nX-3.\nG90 M99\n%\n";

/// Files of a test and how to rewrite one of them.
struct Bench {
    folder: Folder,
    transform: String,
    out: String,
}

impl Bench {
    fn new(transform: &str) -> Self {
        let folder = Folder::new();
        Self {
            transform: folder.file("t.json", transform),
            out: folder.path("out.nc"),
            folder,
        }
    }

    /// Rewrites, with these options.
    fn rewrite(&self, program: &str, more: &[&str]) -> crate::rig::run::Ran {
        let args = ["nc", "rewrite", program, "-o", &self.out];
        umi(&[&args[..], &["--transform", &self.transform], more].concat())
    }

    fn made(&self) -> String {
        std::fs::read_to_string(&self.out).unwrap()
    }
}

/// A program that is called and is not in the file: refused; allowed by its number; or brought,
/// and then rewritten with its caller, which moves as both do.
#[test]
fn a_call_of_what_is_not_there() {
    let bench = Bench::new(QUARTER);
    let program = bench.folder.file("p.nc", CALLER);
    bench
        .rewrite(&program, &[])
        .exits(2)
        .says("p.nc, line 5, column 1: calls O9010, which is not in the file")
        .says("--allow-call P9010");
    let checked = umi(&["nc", "check", &program]).exits(2);
    assert!(checked.out.contains("calls O9010"), "{}", checked.out);
    bench.rewrite(&program, &["--allow-call", "P9010"]).exits(0);
    assert!(bench.made().contains("M98 P9010\n"), "{}", bench.made());

    let called = bench.folder.file("o9010.nc", CALLED);
    bench
        .rewrite(&program, &["--load", &called, "--force"])
        .exits(0);
    let made = bench.made();
    assert!(
        made.ends_with("M30\nO9010\nG91 G1 X0. Y3. F100\nX0. Y-3.\nG90 M99\n%\n"),
        "{made}"
    );
    // A control would take either of two programs of a number.
    for twice in [&called, &program] {
        bench
            .rewrite(&program, &["--load", &called, "--load", twice, "--force"])
            .exits(1)
            .says("comes twice, in ");
    }
    let diff = ["nc", "diff", &program, &bench.out, "--load", &called];
    let diff = [&diff[..], &["--transform", &bench.transform, "--json"]].concat();
    let same = umi(&diff).exits(0).json();
    assert_eq!(same["complete"], true);
    assert_eq!(same["moves_a"], 4);

    // A line of the loaded file is told with its file.
    let bad = bench.folder.file("bad.nc", CALLED.replace("X-3.", "X#101"));
    bench
        .rewrite(&program, &["--load", &bad, "--force"])
        .exits(2)
        .says("bad.nc, line 4, column 1: X has a value that only the control knows");
    let unnamed = bench.folder.file("unnamed.nc", "G91 G1 X3. F100\nM99\n");
    bench
        .rewrite(&program, &["--load", &unnamed, "--force"])
        .exits(1)
        .says("no O number");
    // A correction in the control and in the path: its G68 is told.
    let correction = "%\nO9010\nG10 L2 P2 X1. Y0. Z0.\nG55\nG68 X0. Y0. R5.\nM99\n%\n";
    let correction = bench.folder.file("correction.nc", correction);
    bench
        .rewrite(&program, &["--load", &correction, "--force"])
        .exits(2)
        .says("correction.nc, line 5, column 1: G68 changes the coordinates");
}

/// A rewritten program is moved once more on demand only.
#[test]
fn a_second_rewriting() {
    let bench = Bench::new(QUARTER);
    let program = bench.folder.file("p.nc", "G21 G90\nG0 X10. Y0. Z5.\nM30\n");
    bench.rewrite(&program, &[]).exits(0);
    let once = bench.folder.file("once.nc", bench.made());
    bench
        .rewrite(&once, &["--force"])
        .exits(2)
        .says("rewritten before")
        .says("--again");
    bench.rewrite(&once, &["--force", "--again"]).exits(0);
    assert!(
        bench.made().contains("G0 X-9. Y1. Z5.\n"),
        "{}",
        bench.made()
    );
}

/// Words that controls understand differently: somebody says whose program it is.
#[test]
fn whose_program_it_is() {
    let bench = Bench::new(LEAN);
    let turns = "G21 G90 G0 X10. Y0. Z0.\nG3 X10. Y0. I-10. J0. P2 F9\nM2\n";
    let turns = bench.folder.file("turns.ngc", turns);
    let below = "G21 G90 G0 X0. Y0. Z1.\nG98 G81 X9. Y0. Z-5. R2. F9\nG80\nM2\n";
    let below = bench.folder.file("below.ngc", below);
    for (program, says, options) in [
        (&turns, "P on an arc counts turns", &["linuxcnc"][..]),
        (&below, "begins below its R", &["fanuc", "linuxcnc"]),
    ] {
        bench
            .rewrite(program, &["--force"])
            .exits(2)
            .says(says)
            .says("--dialect");
        for dialect in options {
            bench
                .rewrite(program, &["--force", "--dialect", dialect])
                .exits(0);
        }
    }
    bench
        .rewrite(&turns, &["--force", "--dialect", "fanuc"])
        .exits(2);
    let word = "G21 G90 G0 X10. Y0. Z0.\nG3 X10. Y0. I-10. J0. Q2 F9\nM2\n";
    let word = bench.folder.file("word.ngc", word);
    bench
        .rewrite(&word, &["--force", "--dialect", "linuxcnc"])
        .exits(2)
        .says("Q has no meaning here");
}

/// Each refusal names what allows it, and nothing else: no option that would not help.
#[test]
fn the_options_that_help() {
    let bench = Bench::new(QUARTER);
    let start = "G21 G90 G0 X10. Y0. Z0.\n";
    for (line, says, option) in [
        ("M98", "calls no program", None),
        ("M98 Q20", "Q here calls from a block number on", None),
        ("M98 P2 H20", "H here calls from a block number on", None),
        (
            "M198 P2",
            "calls O2 of another device",
            Some("(--allow-call P2)"),
        ),
        ("G66 P9010 A1.", "calls a macro behind every motion", None),
        ("G80.9010", "this is no G code", None),
        (
            "(Umi rewritten from)",
            "rewritten before",
            Some("(--again)"),
        ),
        (
            "G55 X1.",
            "give the origins of both",
            Some("(--origin G54=X,Y,Z --origin G55=X,Y,Z, in machine coordinates)"),
        ),
        ("M98 P9001\nX2.", "write it into this block", None),
        (
            "o7 call [1]",
            "calls O7 by an O word",
            Some("(--allow-call P7)"),
        ),
        (
            "G1 X1. F9; X2.",
            "words behind `;`",
            Some("(--dialect linuxcnc)"),
        ),
        ("M72", "gives back the modes", Some("(--dialect fanuc)")),
        (
            "G92 X1.\nG52 X1.",
            "one shift for LinuxCNC",
            Some("(--dialect fanuc or linuxcnc)"),
        ),
        ("G1 X5. ,A30. F9", ",A is not known", None),
        ("M30\n%\n%\nO2", "words behind the closing `%`", None),
        ("L100", "L has no meaning here", None),
    ] {
        let program = bench.folder.file("p.nc", [start, line, "\nM30\n"].concat());
        let options = ["--force", "--allow-call", "P9001"];
        let mut refused = bench.rewrite(&program, &options).exits(2).says(says);
        if let Some(option) = option {
            refused = refused.says(option);
        }
        assert_eq!(
            refused.err.contains("--"),
            option.is_some(),
            "{}",
            refused.err
        );
    }
    let program = bench
        .folder
        .file("p.nc", [start, "M198 P2\nM30\n"].concat());
    bench
        .rewrite(&program, &["--force", "--allow-call", "P2"])
        .exits(0);
    assert!(bench.made().contains("\nM198 P2\n"), "{}", bench.made());
    // One unit is said twice, or two.
    let program = bench.folder.file("p.nc", "G90 G0 X1. Y0. Z0.\nM30\n");
    let said = ["--force", "--start", "G21", "--unit"];
    bench
        .rewrite(&program, &[&said[..], &["inch"]].concat())
        .exits(1)
        .says("--unit");
    bench
        .rewrite(&program, &[&said[..], &["mm"]].concat())
        .exits(0);
}

/// Modes that a program takes for granted are stated; what contradicts itself is none.
#[test]
fn modes_are_stated() {
    let bench = Bench::new(QUARTER);
    let program = bench
        .folder
        .file("p.nc", "G0 X10. Y0. Z5.\nG2 X12. Y0. I1. J0. F9\nM2\n");
    bench
        .rewrite(&program, &[])
        .exits(2)
        .says("neither G90 nor G91 is in force")
        .says("--start G90");
    bench
        .rewrite(&program, &["--start", "G90,G17,G21"])
        .exits(0);
    assert!(
        bench.made().contains("G2 X1. Y12. I0. J1. F9\n"),
        "{}",
        bench.made()
    );
    for bad in ["G90,G91", "M3", "G4", "90"] {
        bench
            .rewrite(&program, &["--force", "--start", bad])
            .exits(1)
            .says("is no mode to begin with");
    }
}

/// What a replay printed of a verdict with a run does not say how a control compares runs: no
/// program is made of it that would run in any other. Two programs are compared by it all the same.
#[test]
fn a_printed_verdict_of_a_run_makes_no_program() {
    let bench = Bench::new(QUARTER);
    let (session, job) = (
        project("examples/four-spheres.txt"),
        project("examples/four-spheres.toml"),
    );
    let printed = umi(&["replay", &session, "--job", &job, "--json"]).out;
    let is_wanted = |line: &&str| line.contains("\"plate\":1,") && line.contains("of_run");
    let verdict = printed.lines().find(is_wanted).unwrap();
    let printed = bench.folder.file("v.jsonl", verdict);
    let program = bench.folder.file("p.nc", "G21 G90\nG0 X10. Y0. Z5.\nM30\n");
    let correction = ["correction", "--verdict", &printed, "--job", &job, "--json"];
    let rewrite = [
        "nc",
        "rewrite",
        &program,
        "-o",
        &bench.out,
        "--verdict",
        &printed,
        "--json",
    ];
    for makes in [&correction[..], &rewrite] {
        let said = umi(makes).exits(2);
        assert_eq!(said.json()["error"]["code"], "run_not_compared");
        assert_eq!(said.json()["error"]["run"], 2);
    }
    assert!(!std::path::Path::new(&bench.out).exists());
    // The part has moved, and so the same program is no image of itself.
    umi(&["nc", "diff", &program, &program, "--verdict", &printed]).exits(2);
    umi(&["nc", "check", &program, "--verdict", &printed]).exits(0);
    let registration = &serde_json::from_str::<serde_json::Value>(verdict).unwrap()["registration"];
    let moved = bench.folder.file("moved.json", registration.to_string());
    umi(&[
        "nc",
        "rewrite",
        &program,
        "-o",
        &bench.out,
        "--transform",
        &moved,
    ])
    .exits(0);
    umi(&["nc", "diff", &program, &bench.out, "--verdict", &printed]).exits(0);
}

/// A verdict moves the same, whether a journal brings it, what a replay printed, or the board.
#[test]
fn a_verdict_means_one_thing() {
    use umi_core::brain::{Brain, Output};
    use umi_core::units::Micros;
    use umi_protocol::message::Record;

    let bench = Bench::new(QUARTER);
    let (session, job) = (
        project("tests/reference/sessions/session_a.txt"),
        project("examples/three-spheres.toml"),
    );
    let printed = umi(&["replay", &session, "--job", &job, "--json"]).out;
    let printed = bench.folder.file("v.jsonl", printed);
    let job: umi_protocol::job::Job =
        toml::from_str(&std::fs::read_to_string(job).unwrap()).unwrap();
    let mut board = crate::rig::board::Board::new(0);
    board.push(&Record::JobSet {
        job: job.clone(),
        key_id: None,
    });
    board.job = Some(job.clone());
    let mut brain = Brain::new(job).unwrap();
    brain.bytes(
        Micros(1),
        &std::fs::read(session).unwrap(),
        &mut |output: Output<'_>| {
            if let Output::Verdict(verdict) = output {
                board.verdict = Some(verdict.clone());
            }
        },
    );
    brain.input_ended(Micros(2), &mut |output: Output<'_>| {
        if let Output::Verdict(verdict) = output {
            board.verdict = Some(verdict.clone());
        }
    });
    board.push(&Record::Verdict(board.verdict.clone().unwrap()));
    let port = board.serve();
    let journal = bench.folder.path("j.umij");
    umi(&["log", "--port", &port, "-o", &journal]).exits(0);

    let program = bench.folder.file("p.nc", "G21 G90\nG0 X10. Y0. Z5.\nM30\n");
    let moved = |verdict: &[&str]| {
        let args = ["nc", "rewrite", &program, "-o", "-", "--verdict"];
        let made = umi(&[&args[..], verdict].concat()).exits(0).out;
        assert!(made.contains("(VERDICT OK - "), "{made}");
        let kept: Vec<&str> = made
            .lines()
            .filter(|line| !line.starts_with("(VERDICT"))
            .collect();
        kept.join("\n")
    };
    let by_board = moved(&["board", "--port", &port]);
    assert_eq!(moved(&[&printed]), by_board);
    // This board has no key.
    assert_eq!(moved(&[&journal, "--unsigned"]), by_board);
    assert_eq!(moved(&[&journal, "--unsigned", "--plate", "4"]), by_board);
    // And so does the correction program.
    for verdict in [&["board", "--port", &port][..], &[&journal, "--unsigned"]] {
        let args = [&["correction", "--verdict"], verdict].concat();
        let made = umi(&args).exits(0).out;
        assert!(made.contains("G68"), "{made}");
    }
    umi(&[
        "nc",
        "rewrite",
        &program,
        "-o",
        "-",
        "--verdict",
        &journal,
        "--unsigned",
        "--plate",
        "99",
    ])
    .exits(1)
    .says("no such verdict");
}

/// A program that is carried by a verdict of a counted run begins with an alarm for every other
/// run; `umi nc diff` drives it in its own. Where runs are not counted, that is said.
#[test]
fn a_program_belongs_to_its_run() {
    use umi_core::brain::{Brain, Output};
    use umi_core::units::Micros;
    use umi_protocol::message::Record;
    use umi_protocol::reason::Reason;
    use umi_protocol::verdict::SetupReason;

    let bench = Bench::new(QUARTER);
    let text = |file: &str| std::fs::read_to_string(project(file)).unwrap();
    let plain: umi_protocol::job::Job =
        toml::from_str(&text("examples/three-spheres.toml")).unwrap();
    let mut last = None;
    let mut brain = Brain::new(plain.clone()).unwrap();
    let session = text("tests/reference/sessions/session_a.txt");
    let mut take = |output: Output<'_>| {
        if let Output::Verdict(verdict) = output {
            last = Some(verdict.clone());
        }
    };
    brain.bytes(Micros(1), session.as_bytes(), &mut take);
    brain.input_ended(Micros(2), &mut take);
    let program = bench.folder.file("p.nc", "G21 G90\nG0 X10. Y0. Z5.\nM30\n");
    let moved = |counted: bool| {
        let (mut job, mut verdict) = (plain.clone(), last.clone().unwrap());
        if counted {
            job.guards.run_variable = Some(531);
            let reason = Reason::OfRun { run: 42 };
            let remark = SetupReason {
                feature: None,
                reason,
            };
            verdict.remarks.push(remark).unwrap();
        }
        let mut board = crate::rig::board::Board::new(0);
        board.push(&Record::JobSet { job, key_id: None });
        board.push(&Record::Verdict(verdict));
        let journal = bench.folder.path("j.umij");
        umi(&["log", "--port", &board.serve(), "-o", &journal, "--force"]).exits(0);
        let args = ["nc", "rewrite", &program, "-o", &bench.out, "--force"];
        let args = [&args[..], &["--verdict", &journal, "--unsigned"]].concat();
        let said = umi(&args).exits(0).out;
        let machine = umi(&[&args[..], &["--json"]].concat()).exits(0).json();
        let diff = ["nc", "diff", &program, &bench.out, "--verdict", &journal];
        umi(&[&diff[..], &["--unsigned"]].concat()).exits(0);
        let made = bench.made();
        // Its comparison is none for another control.
        let other = umi(&[&args[..], &["--dialect", "linuxcnc"]].concat());
        if counted {
            other.exits(2).says("the job of the verdict is for another");
            assert_eq!(bench.made(), made);
        } else {
            other.exits(0);
        }
        umi(&[&args[..], &["--dialect", "fanuc"]].concat()).exits(0);
        (said, machine, made)
    };
    let (said, machine, made) = moved(true);
    assert!(said.contains("alarm unless #531 is 42"), "{said}");
    assert_eq!(
        (&machine["run"], &machine["run_variable"]),
        (&42.into(), &531.into())
    );
    assert!(made.contains(" - RUN 42)\n"), "{made}");
    let first = made.lines().find(|line| !line.starts_with('('));
    assert_eq!(
        first,
        Some("IF[#531NE42]THEN#3000=2(UMI PROGRAM OF RUN 42)")
    );
    // Again, by a transform that knows no run: it stays, and that is said.
    let once = bench.folder.file("once.nc", made);
    let said = bench.rewrite(&once, &["--force", "--again"]).exits(0).out;
    assert!(
        said.contains("stays: alarm unless this is run 42"),
        "{said}"
    );
    assert!(bench.made().contains("UMI PROGRAM OF RUN 42"));
    let machine_again = bench
        .rewrite(&once, &["--force", "--again", "--json"])
        .exits(0)
        .json();
    assert_eq!(machine_again["earlier_run"], 42);
    let (said, machine, made) = moved(false);
    assert!(said.contains("not compared with the control's"), "{said}");
    assert!(machine["run"].is_null() && !made.contains("#531"), "{made}");
}
