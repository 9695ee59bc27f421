//! Every command has a help text with examples that can be run as they stand.

use crate::rig::run::{Ran, umi};

/// The commands that a help text lists.
fn listed(help: &str) -> Vec<String> {
    let lines = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    lines
        .take_while(|line| !line.is_empty())
        // What a description goes on with stands further in.
        .filter(|line| !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|name| *name != "help")
        .map(str::to_owned)
        .collect()
}

/// All commands with their help, also those below others.
fn all() -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut open: Vec<Vec<String>> = vec![Vec::new()];
    while let Some(path) = open.pop() {
        let mut args: Vec<&str> = path.iter().map(String::as_str).collect();
        args.push("--help");
        let help = umi(&args).exits(0).out;
        for name in listed(&help) {
            open.push(path.iter().cloned().chain([name]).collect());
        }
        found.push((path.join(" "), help));
    }
    found
}

/// No command is without examples, and each example is one of that command.
#[test]
fn every_command_shows_examples() {
    let commands = all();
    for name in [
        "fit",
        "register",
        "job",
        "job check",
        "job set",
        "info",
        "log",
        "program list",
        "program put",
        "program get",
        "program delete",
        "events",
        "watch",
        "machine run",
        "machine check",
        "correction",
        "dialects",
    ] {
        assert!(
            commands.iter().any(|(path, _)| path == name),
            "no command {name}"
        );
    }
    for (path, help) in commands.iter().filter(|(path, _)| !path.is_empty()) {
        let examples = help.split_once("Examples:\n");
        let (_, examples) = examples.unwrap_or_else(|| panic!("`umi {path}`: no examples"));
        let own = examples
            .lines()
            .any(|line| line.contains(&format!("umi {path} ")));
        assert!(
            own || examples.contains(&format!("umi {path}\n")),
            "umi {path}: {examples}"
        );
    }
}

/// Lines that go on, in one: further blanks would begin an explanation.
fn join(parts: &[&str]) -> String {
    let mut parts = parts.iter();
    let first = parts.next().copied().unwrap_or_default().to_owned();
    parts.fold(first, |whole, part| whole + " " + part.trim_start())
}

/// Every option that an example uses exists: run with `--help` behind it, it is accepted.
#[test]
fn examples_use_options_that_exist() {
    let mut tried = 0;
    for (path, help) in all() {
        let (_, examples) = help.split_once("Examples:\n").unwrap_or_default();
        // A call that goes on in the next line is one call.
        let whole: Vec<&str> = examples.split("\\\n").map(str::trim_end).collect();
        let examples = join(&whole);
        for line in examples.lines().take_while(|line| line.starts_with("  ")) {
            let Some((_, call)) = line.split_once("umi ") else {
                continue;
            };
            // Explanations stand behind two blanks, other programs behind a pipe.
            let call = call.split("  ").next().unwrap_or_default();
            let call = call.split(['|', '>']).next().unwrap_or_default();
            let mut args: Vec<&str> = call.split_whitespace().collect();
            args.push("--help");
            let Ran { status, err, .. } = umi(&args);
            assert_eq!(status, 0, "`umi {path}` shows {line:?}: {err}");
            tried += 1;
        }
    }
    assert!(tried > 12, "{tried}");
}

/// Exit statuses are documented.
#[test]
fn exit_statuses_are_documented() {
    let help = umi(&["--help"]).out;
    for words in ["Exit status:", "  0  ", "  1  ", "  2  ", "NO_COLOR"] {
        assert!(help.contains(words), "{words}");
    }
}

/// With `--json` a wrong use is an object, too, whichever command it is; help is no error and stays text.
#[test]
fn a_wrong_use_is_one_object_with_json() {
    for args in [
        &["scan", "pair", "--json"][..],
        &["--json", "fit"],
        &["scan", "merge", "--nonsense", "--json"],
        &["nonsense", "--json"],
    ] {
        let ran = umi(args).exits(1);
        assert!(ran.err.is_empty(), "{args:?}: {}", ran.err);
        assert_eq!(ran.json()["error"]["code"], "usage", "{args:?}");
    }
    let plain = umi(&["scan", "pair"]).exits(1);
    assert!(plain.out.is_empty() && plain.err.contains("Usage"));
    assert!(
        umi(&["scan", "pair", "--help", "--json"])
            .exits(0)
            .out
            .contains("Usage")
    );
    // Behind `--` it is a file's name.
    let named = umi(&["scan", "pair", "a", "--", "b", "c", "--json"]).exits(1);
    assert!(named.out.is_empty(), "{}", named.out);
}
