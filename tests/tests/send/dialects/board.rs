//! The board itself sends whatever dialect its job asks for.

use std::time::Duration;

use umi_client::problem::Problem;
use umi_client::session::DecisionRecord;
use umi_core::dprnt::encode;
use umi_desk::capture::Desk;
use umi_protocol::job::{Dialect, Job};
use umi_protocol::pattern::Coding;
use umi_protocol::verdict::Verdict;

const SESSION: &str = include_str!("../../../reference/sessions/session_a.txt");
const JOB: &str = include_str!("../../../../examples/three-spheres.toml");
const DC1: u8 = 0x11;

fn job(dialect: Dialect) -> Job {
    let name = format!("dialect = \"{}\"", dialect.name());
    let text = JOB.replace("dialect = \"g10-g68\"", &name);
    assert!(text.contains(&name));
    toml::from_str(&text).unwrap()
}

/// The first two clampings of the session: one that is taught, one that is corrected.
fn verdict(bench: &mut Desk, code: impl Fn(u8) -> u8) -> Verdict {
    let mut verdicts = Vec::new();
    let lines: Vec<&str> = SESSION.split_inclusive('\n').collect();
    let text = lines[..lines.len() * 2 / 5].concat();
    let bytes: Vec<u8> = text.bytes().filter(|b| *b != b'\r').map(code).collect();
    bench
        .play(&bytes, |decision| {
            if let DecisionRecord::Verdict(verdict) = decision {
                verdicts.push(*verdict);
            }
            Ok::<_, Problem>(())
        })
        .unwrap();
    assert_eq!(verdicts.len(), 2);
    verdicts.pop().unwrap()
}

/// READ gets the program of the verdict to the last byte, in every dialect that suffices; one
/// that cannot turn makes the verdict NG and sends nothing.
#[test]
fn a_board_sends_the_dialect_of_its_job() {
    for dialect in Dialect::ALL {
        let mut bench = Desk::new(&job(dialect)).unwrap();
        let verdict = verdict(&mut bench, |byte| byte);
        if dialect == Dialect::Grbl {
            assert_eq!(verdict.reasons[0].reason.code(), "leftover");
            assert!(!bench.client().status().unwrap().correction_waiting);
            continue;
        }
        assert!(verdict.ok, "{dialect:?}: {:?}", verdict.reasons);
        let correction = verdict.correction.unwrap();
        assert_eq!(correction.dialect, dialect);
        bench.board().control_sends(&[DC1]);
        let read: Vec<u8> = (0..correction.text.len())
            .map(|_| {
                bench
                    .board()
                    .control_receives(Duration::from_secs(60))
                    .unwrap()
            })
            .collect();
        assert_eq!(String::from_utf8(read).unwrap(), correction.text.as_str());
    }
}

/// EIA has no `#`: of a program that needs it not even the beginning goes out.
#[test]
fn what_a_code_does_not_have_is_not_begun() {
    for (dialect, has) in [(Dialect::G10G68, true), (Dialect::Variables, false)] {
        let mut job = job(dialect);
        job.receiver.coding = Coding::Eia;
        if !has {
            // Said, it is refused; found out by listening, nothing is begun.
            let refused = Desk::new(&job).err().expect("a refusal");
            assert_eq!(refused.code, "coding_lacks");
            job.receiver.coding = Coding::Auto;
        }
        let mut bench = Desk::new(&job).unwrap();
        let verdict = verdict(&mut bench, |byte| {
            // A separator of the session that EIA does not have.
            let byte = if byte == b'*' { b' ' } else { byte };
            encode(Coding::Eia, byte).unwrap()
        });
        let text = verdict.correction.unwrap().text;
        bench.board().control_sends(&[DC1]);
        let wait = Duration::from_secs(if has { 60 } else { 1 });
        let first = bench.board().control_receives(wait);
        let expected = encode(Coding::Eia, text.as_bytes()[0]).filter(|_| has);
        assert_eq!(first, expected, "{dialect:?}");
    }
}
