//! What the page of the structure names is there: whoever follows it finds it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Files and folders that `docs/architecture.md` sends its readers to: what stands between
/// backquotes with a slash, from the top, or from a folder of crates.
#[test]
fn architecture_names_what_is_there() {
    let top = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let page = std::fs::read_to_string(top.join("docs/architecture.md")).expect("the page");
    let mut found = BTreeSet::new();
    let mut missing = Vec::new();
    for named in page.split('`').skip(1).step_by(2) {
        if !is_path(named) {
            continue;
        }
        if alternatives(named).iter().all(|named| exists(&top, named)) {
            found.insert(named);
        } else {
            missing.push(named);
        }
    }
    assert!(found.len() > 40, "read {} paths only", found.len());
    assert_eq!(
        missing,
        Vec::<&str>::new(),
        "no such file: correct the page"
    );
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

/// Whether a path is there, which may begin within a crate's parent and end in `*`.
fn exists(top: &Path, named: &str) -> bool {
    let starts = [
        "",
        "firmware",
        "host",
        "docs",
        "host/umi",
        "firmware/core/src",
        "firmware/core/src/dprnt",
        "host/umi/src",
    ];
    let (folder, star) = match named.split_once('*') {
        Some((before, _)) => (before.rsplit_once('/').map_or("", |(to, _)| to), true),
        None => (named.trim_end_matches('/'), false),
    };
    starts.iter().any(|start| {
        let path: PathBuf = top.join(start).join(folder);
        path.exists() && (!star || path.is_dir())
    })
}
