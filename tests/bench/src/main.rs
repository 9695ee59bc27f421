//! Does the work that openumi is measured at: see `cargo xtask bench`, which calls this.
//!
//! `umi-bench write FOLDER` writes the data of every task, for peers in other languages.
//! `umi-bench time` prints how long each contender takes, one JSON object a line.
//! `umi-bench repeat TASK CONTENDER N` does one of them N times, to be counted.
//! `umi-bench stream MEGABYTES` rewrites a path of that size, and says what memory it took.
//! `umi-bench path MEGABYTES FOLDER` writes such a path and its transform.

mod data;
mod fit;
mod point;
mod receiver;
mod registration;
mod rewrite;
mod timing;

use std::hint::black_box;
use std::path::Path;

use anyhow::{Context as _, Result, bail};

use crate::data::Data;

/// Somebody who can do a task.
struct Contender {
    /// What is done.
    task: &'static str,
    /// By whom.
    by: &'static str,
    /// How much is read, where the task is reading.
    bytes: Option<usize>,
    /// Does it once.
    work: Work,
}

/// Does a task; the answer replaces what is in the vector, which is empty if there is none.
type Work = Box<dyn Fn(&mut Vec<f64>)>;

fn contenders(data: &Data) -> Vec<Contender> {
    let mut all = Vec::from(receiver::contenders(data));
    all.extend(fit::contenders(data));
    all.extend(registration::contenders(data));
    all.extend(point::contenders(data));
    all.extend(rewrite::contenders(data));
    all
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let data = Data::load()?;
    match arguments[..] {
        ["write", folder] => data.write(Path::new(folder)),
        ["time"] => {
            let all = contenders(&data);
            for same in all.chunk_by(|one, next| one.task == next.task) {
                for figures in timing::measure(same) {
                    println!("{figures}");
                }
            }
            Ok(())
        }
        ["repeat", task, by, times] => {
            let all = contenders(&data);
            let contender = all
                .iter()
                .find(|contender| contender.task == task && contender.by == by)
                .with_context(|| format!("no {by} for {task}"))?;
            let mut answer = Vec::new();
            for _ in 0..times.parse::<u32>().context("N is a number")? {
                (contender.work)(&mut answer);
                black_box(&answer);
            }
            Ok(())
        }
        ["stream", megabytes] => {
            let stream = rewrite::stream(megabytes.parse().context("MEGABYTES is a number")?)?;
            println!("{stream}");
            Ok(())
        }
        ["path", megabytes, folder] => rewrite::write(
            megabytes.parse().context("MEGABYTES is a number")?,
            Path::new(folder),
        ),
        _ => bail!(
            "write FOLDER, time, repeat TASK CONTENDER N, stream MEGABYTES, or path MEGABYTES FOLDER"
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Contenders are compared only on work that they all do right: every answer to a
    /// task agrees with the first, to a nanometre in lengths and 1e-9 in the rest.
    #[test]
    fn contenders_agree() {
        let all = contenders(&Data::load().unwrap());
        for contender in &all {
            let first = all.iter().find(|first| first.task == contender.task);
            let (mut expected, mut answer) = (Vec::new(), Vec::new());
            (first.unwrap().work)(&mut expected);
            (contender.work)(&mut answer);
            assert!(!expected.is_empty(), "{}", contender.task);
            assert_eq!(expected.len(), answer.len(), "{}", contender.by);
            for (index, (expected, answer)) in expected.iter().zip(&answer).enumerate() {
                assert!(
                    (expected - answer).abs() < 1e-6,
                    "{} by {}: value {index} is {answer}, not {expected}",
                    contender.task,
                    contender.by
                );
            }
        }
    }

    /// Each task has someone to be compared with.
    #[test]
    fn every_task_has_a_peer() {
        let all = contenders(&Data::load().unwrap());
        for contender in &all {
            let same = all.iter().filter(|other| other.task == contender.task);
            assert!(same.count() >= 2, "{} has no peer", contender.task);
        }
    }
}
