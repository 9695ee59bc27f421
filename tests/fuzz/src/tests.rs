//! Every kept input holds, and so do changes of it: bytes set, taken out and put in, pieces of others, ends cut off.

use std::path::Path;

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{Config, TestRunner};

use crate::targets::TARGETS;

/// How many changed inputs each target is given.
const CHANGED: u32 = 20_000;

#[derive(Clone, Debug)]
enum Change {
    Set(Index, u8),
    Insert(Index, Vec<u8>),
    Remove(Index, usize),
    /// A piece of another kept input, or of the same.
    Splice(Index, Index, Index, usize),
    Cut(Index),
}

fn change() -> impl Strategy<Value = Change> {
    // Bytes that mean something to one reader or another, and any.
    let byte = prop_oneof![
        prop::sample::select(&b"\0\x01\x7F\x80\xFF\n\r ,;.-+09#%XGM\"[]="[..]),
        any::<u8>()
    ];
    let place = any::<Index>;
    prop_oneof![
        4 => (place(), byte.clone()).prop_map(|(at, byte)| Change::Set(at, byte)),
        2 => (place(), vec(byte, 1..6)).prop_map(|(at, bytes)| Change::Insert(at, bytes)),
        2 => (place(), 1..9_usize).prop_map(|(at, count)| Change::Remove(at, count)),
        2 => (place(), place(), place(), 1..64_usize)
            .prop_map(|(at, other, from, count)| Change::Splice(at, other, from, count)),
        1 => place().prop_map(Change::Cut),
    ]
}

/// Shown as it would be written in a test.
struct Input(Vec<u8>);

impl std::fmt::Debug for Input {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "b\"{}\"", self.0.escape_ascii())
    }
}

/// A kept input as the changes leave it.
fn changed(kept: &[Vec<u8>], first: &Index, changes: &[Change]) -> Vec<u8> {
    let mut bytes = first.get(kept).clone();
    for change in changes {
        let place = |at: &Index| at.index(bytes.len() + 1);
        match change {
            Change::Set(at, byte) => {
                let at = place(at);
                if let Some(there) = bytes.get_mut(at) {
                    *there = *byte;
                }
            }
            Change::Insert(at, more) => {
                let at = place(at);
                bytes.splice(at..at, more.iter().copied());
            }
            Change::Remove(at, count) => {
                let at = place(at);
                bytes.drain(at..bytes.len().min(at + count));
            }
            Change::Splice(at, other, from, count) => {
                let at = place(at);
                let other = other.get(kept);
                let from = from.index(other.len() + 1);
                let piece = other.iter().skip(from).take(*count);
                bytes.splice(at..at, piece.copied());
            }
            Change::Cut(at) => bytes.truncate(place(at)),
        }
    }
    bytes
}

/// The kept inputs of a target, in the order of their names.
fn kept(name: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("corpus")
        .join(name);
    let entries = std::fs::read_dir(&folder).expect("each target has a corpus");
    let mut files: Vec<_> = entries
        .map(|entry| entry.expect("is there").path())
        .collect();
    files.sort();
    let read = |file| std::fs::read(file).expect("can be read");
    files.iter().map(read).collect()
}

fn holds(name: &str) {
    let (_, target) = TARGETS
        .iter()
        .find(|(target, _)| *target == name)
        .expect("is a target");
    let kept = kept(name);
    assert!(!kept.is_empty(), "{name} has no inputs");
    for input in &kept {
        target(input);
    }
    let config = Config {
        cases: CHANGED,
        failure_persistence: None,
        ..Config::default()
    };
    let inputs = (any::<Index>(), vec(change(), 1..8))
        .prop_map(move |(first, changes)| Input(changed(&kept, &first, &changes)));
    let run = TestRunner::new(config).run(&inputs, |input| {
        target(&input.0);
        Ok(())
    });
    run.unwrap_or_else(|failure| panic!("{name}: {failure}"));
}

macro_rules! each_holds {
    ($($name:ident)*) => {
        $(#[test] fn $name() { holds(stringify!($name)); })*

        /// No target is left out.
        #[test]
        fn all_are_tried() {
            let names: Vec<&str> = TARGETS.iter().map(|(name, _)| *name).collect();
            assert_eq!(names, [$(stringify!($name)),*]);
        }
    };
}

each_holds! { control files frame journal memory nc point_sensor receiver rewrite scan_files session }
