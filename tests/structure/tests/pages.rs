//! What pages name is there: whoever follows them finds it.

use std::collections::BTreeSet;
use std::path::Path;

/// Files and folders that the page of the structure sends its readers to: what stands between
/// backquotes with a slash, from the top, or from a folder of crates.
#[test]
fn architecture_names_what_is_there() {
    let short = [
        "",
        "firmware",
        "host",
        "docs",
        "host/umi",
        "host/umi/src",
        "firmware/core/src",
        "firmware/core/src/dprnt",
    ];
    holds("docs/architecture.md", &short, |_| true);
}

/// The tests that hold a promise, and what else its page names from the top.
#[test]
fn promises_name_tests_that_are_there() {
    let rooms = ["docs/", "firmware/", "host/", "hw/", "protocol/", "tests/"];
    holds("docs/promises.md", &[""], |named| {
        rooms.iter().any(|room| named.starts_with(room))
    });
}

fn holds(page: &str, starts: &[&str], is_meant: impl Fn(&str) -> bool) {
    let top = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let text = std::fs::read_to_string(top.join(page)).expect("the page");
    let named: BTreeSet<&str> = text
        .split('`')
        .skip(1)
        .step_by(2)
        .filter(|named| is_path(named) && is_meant(named))
        .collect();
    assert!(named.len() > 40, "read {} paths only", named.len());
    let is_there = |named: &&str| {
        let all = alternatives(named);
        all.iter().all(|named| exists(&top, starts, named))
    };
    let missing: Vec<&str> = named.into_iter().filter(|named| !is_there(named)).collect();
    assert_eq!(missing, Vec::<&str>::new(), "no such file: correct {page}");
}

/// `a/{b,c}/d` names two.
fn alternatives(named: &str) -> Vec<String> {
    let braces = named.split_once('{').and_then(|(before, rest)| {
        let (inside, after) = rest.split_once('}')?;
        Some((before, inside, after))
    });
    match braces {
        Some((before, inside, after)) => inside
            .split(',')
            .map(|part| format!("{before}{part}{after}"))
            .collect(),
        None => vec![named.to_owned()],
    }
}

fn is_path(named: &str) -> bool {
    named.contains('/') && !named.contains(' ') && !named.contains("::")
}

/// Whether a path is there from one of these folders; it may end in `*`.
fn exists(top: &Path, starts: &[&str], named: &str) -> bool {
    let (folder, star) = match named.split_once('*') {
        Some((before, _)) => (before.rsplit_once('/').map_or("", |(to, _)| to), true),
        None => (named.trim_end_matches('/'), false),
    };
    starts.iter().any(|start| {
        let path = top.join(start).join(folder);
        path.exists() && (!star || path.is_dir())
    })
}
