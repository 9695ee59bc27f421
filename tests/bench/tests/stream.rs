//! What rewriting a long program takes, in a process of its own.

use std::process::Command;

/// What `umi-bench stream` says.
fn stream(megabytes: u64) -> serde_json::Value {
    let run = Command::new(env!("CARGO_BIN_EXE_umi-bench"))
        .args(["stream", &megabytes.to_string()])
        .output()
        .unwrap();
    assert!(run.status.success(), "{run:?}");
    serde_json::from_slice(&run.stdout).unwrap()
}

/// A program twenty times as long takes no more memory: the rewriter is what it is, without a
/// heap, and nothing grows beside it. The long form, 1 GB, is `umi-bench stream 1000`.
#[test]
fn memory_does_not_grow_with_the_program() {
    let number = |told: &serde_json::Value, name: &str| told[name].as_u64().unwrap();
    let (short, long) = (stream(1), stream(20));
    assert!(number(&long, "read_bytes") >= 20_000_000);
    assert!(number(&long, "written_bytes") > 15_000_000);
    let [short_kb, long_kb] = [&short, &long].map(|told| number(told, "peak_memory_kb"));
    // Pages come and go; the input has grown by 19 MB.
    assert!(
        long_kb < short_kb + 1000,
        "{short_kb} KB, then {long_kb} KB"
    );
    // What a board sets aside for it, next to 96 KB of stack.
    assert!(number(&long, "state_bytes") < 7_000, "{long}");
}
