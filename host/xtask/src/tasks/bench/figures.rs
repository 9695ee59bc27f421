//! The figures of one contender at one task.

use anyhow::{Context as _, Result, bail};

/// What was measured of one contender at one task, per call.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Figures {
    /// What is done.
    pub task: String,
    /// By whom.
    pub by: String,
    /// Median of the rounds, nanoseconds.
    pub median_ns: f64,
    /// The fastest round, nanoseconds.
    pub min_ns: f64,
    /// The slowest round, nanoseconds.
    pub max_ns: f64,
    /// Bytes that a call reads, where the task is reading.
    pub bytes: Option<f64>,
    /// Instructions, where they could be counted.
    pub instructions: Option<u64>,
    /// What it came to.
    pub answer: Vec<f64>,
}

impl Figures {
    /// Reads what a contender's program printed: a JSON object a line.
    pub fn parse_all(text: &str) -> Result<Vec<Self>> {
        text.lines()
            .map(|line| {
                let value: serde_json::Value = serde_json::from_str(line)?;
                Self::of(&value)
            })
            .collect::<Result<_>>()
            .with_context(|| format!("these are no figures: {text}"))
    }

    fn of(value: &serde_json::Value) -> Result<Self> {
        let number = |name: &str| value.get(name).and_then(|field| field.as_f64());
        let text = |name: &str| value.get(name).and_then(|field| field.as_str());
        let answer = value.get("answer").and_then(|field| field.as_array());
        Ok(Self {
            task: text("task").context("no task")?.to_owned(),
            by: text("by").context("no contender")?.to_owned(),
            median_ns: number("median_ns").context("no median_ns")?,
            min_ns: number("min_ns").context("no min_ns")?,
            max_ns: number("max_ns").context("no max_ns")?,
            bytes: number("bytes"),
            instructions: None,
            answer: answer
                .context("no answer")?
                .iter()
                .map(|field| field.as_f64().context("an answer that is no number"))
                .collect::<Result<_>>()?,
        })
    }
}

/// How far answers may lie apart: a nanometre in what is in millimetres, and as little in
/// rotations. Iterations that stop a little apart are still the same answer.
const AGREEMENT: f64 = 1e-6;

/// Refuses figures of contenders who do not come to the first one's answer.
pub fn check_agreement(all: &[Figures]) -> Result<()> {
    for figures in all {
        let Some(first) = all.iter().find(|first| first.task == figures.task) else {
            continue;
        };
        let agrees = |(a, b): (&f64, &f64)| (a - b).abs() < AGREEMENT;
        let same = !figures.answer.is_empty()
            && figures.answer.len() == first.answer.len()
            && figures.answer.iter().zip(&first.answer).all(agrees);
        if !same {
            bail!(
                "{}: {} says {:?}, but {} says {:?}",
                figures.task,
                figures.by,
                figures.answer,
                first.by,
                first.answer
            );
        }
    }
    Ok(())
}

/// The instructions that callgrind reports: the number of `Collected : 1234`.
pub fn instructions(said: &str) -> Result<u64> {
    said.lines()
        .find_map(|line| line.split_once("Collected :"))
        .and_then(|(_, number)| number.trim().parse().ok())
        .with_context(|| format!("valgrind counted nothing: {said}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(by: &str, answer: &[f64]) -> Figures {
        Figures {
            task: "sphere".into(),
            by: by.into(),
            answer: answer.to_vec(),
            ..Figures::default()
        }
    }

    /// A different answer, one that is missing and one that is no number are refused.
    #[test]
    fn disagreement_is_refused() {
        let ours = figures("us", &[1.0, 2.0]);
        let check = |answer: &[f64]| check_agreement(&[ours.clone(), figures("they", answer)]);
        assert!(check(&[1.0, 2.0 + 1e-9]).is_ok());
        assert!(check(&[1.0, 2.0 + 1e-5]).is_err());
        assert!(check(&[1.0]).is_err());
        assert!(check(&[1.0, f64::NAN]).is_err());
        assert!(check_agreement(&[figures("us", &[])]).is_err());
    }

    /// What programs print is read; a line without its figures is refused.
    #[test]
    fn lines_are_read() {
        let line = r#"{"task":"t","by":"b","median_ns":2.0,"min_ns":1,"max_ns":3,"bytes":10,"answer":[1.5]}"#;
        let read = Figures::parse_all(line).unwrap();
        assert_eq!(read[0].median_ns, 2.0);
        assert_eq!(read[0].bytes, Some(10.0));
        assert_eq!(read[0].answer, [1.5]);
        assert!(Figures::parse_all(r#"{"task":"t","by":"b"}"#).is_err());
    }

    #[test]
    fn callgrind_is_read() {
        let said = "==12== Events    : Ir\n==12== Collected : 4711\n==12==\n";
        assert_eq!(instructions(said).unwrap(), 4711);
        assert!(instructions("valgrind: no such program").is_err());
    }
}
