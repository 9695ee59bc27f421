//! The table of a board's latches, as `umi events --csv` writes it.
//!
//! A `loss` row stands before the latch that told it. With a number: as many latches from
//! that number on were captured, but not told. Without: edges were not captured.
//!
//! Where the column `what` says `motion` or `transitions`, the board could not follow an encoder:
//! behind `t_ns` its counts are wrong.

use std::collections::BTreeSet;
use std::io::BufRead;
use std::path::Path;

use umi_kinematics::COLUMNS;

use super::table::TableReader;
use crate::ScanError;

/// What a loss is of where only a message is missing; empty in tables of earlier boards.
const MESSAGES: [&str; 5] = ["", "edges", "latches", "counted", "events"];

/// What latched the axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LatchSignal {
    /// The board's own pulses, which trigger the sensor.
    Output,
    /// The sensor's pulses, which the board takes.
    Trigger,
}

impl LatchSignal {
    /// Its name in the table.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Output => "output",
            Self::Trigger => "trigger",
        }
    }
}

/// All axes at one edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TriggerLatch {
    /// Its number among those of its cause.
    pub number: u64,
    /// The board's clock.
    pub t_ns: i64,
    /// The counters, as [`COLUMNS`] are ordered; none where the board has not that axis.
    pub counts: [Option<i64>; COLUMNS.len()],
}

/// The latches of one cause.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Triggers {
    /// Their cause.
    pub cause: LatchSignal,
    /// With numbers and times that rise.
    pub latches: Vec<TriggerLatch>,
    /// How many the table says are missing.
    pub missed: u64,
    /// Those that are missing one behind the other, as runs. A line of the board's own pulses that was missed
    /// (a loss of the cause `output` without a number) never had a pulse and stands alone: it is in no run.
    pub lost_runs: Vec<u64>,
    /// Behind this time the counts are wrong: the board lost motion.
    pub right_until_ns: Option<i64>,
}

impl Triggers {
    /// The latches whose counts are right: all, or those up to a loss of motion.
    #[must_use]
    pub fn right(&self) -> usize {
        self.right_until_ns.map_or(self.latches.len(), |until| {
            self.latches.partition_point(|latch| latch.t_ns <= until)
        })
    }
}

/// Reads the latches of a cause, or of the only one that is there.
///
/// # Errors
/// `no_triggers`, `which_cause`, `board_restarted`; `corrupt` and `truncated` where the
/// table cannot be understood.
pub fn read(path: &Path, cause: Option<LatchSignal>) -> Result<Triggers, ScanError> {
    parse(TableReader::open(path)?, cause)
}

/// As [`read`], from a table that is open.
///
/// # Errors
/// As [`read`].
pub fn parse<R: BufRead>(
    mut table: TableReader<R>,
    cause: Option<LatchSignal>,
) -> Result<Triggers, ScanError> {
    let event = table.column("event")?;
    let number = table.column("number")?;
    let of_cause = table.column("cause")?;
    let t_ns = table.column("t_ns")?;
    let lost = table.column("lost")?;
    let counts = COLUMNS.map(|axis| table.optional(&format!("{axis}_counts")));
    let what = table.optional("what");
    let name = table.name().to_owned();

    let mut right_until_ns: Option<i64> = None;
    let mut latches: [Vec<TriggerLatch>; 2] = [Vec::new(), Vec::new()];
    let mut missed = [0_u64; 2];
    let mut lost_runs: [Vec<u64>; 2] = [Vec::new(), Vec::new()];
    let mut run = [0_u64; 2];
    let mut others = BTreeSet::new();
    while let Some(row) = table.next_row()? {
        let of = what.map_or("", |what| row.text(what));
        if row.text(event) == "loss" && matches!(of, "motion" | "transitions") {
            // Without a time nobody knows from when on they are wrong.
            let until = if row.text(t_ns).is_empty() {
                i64::MIN
            } else {
                row.integer(t_ns)?
            };
            right_until_ns = Some(right_until_ns.map_or(until, |before| before.min(until)));
            continue;
        }
        if row.text(event) == "loss" && !MESSAGES.contains(&of) {
            let words = "motion, transitions, edges, latches, counted or events";
            return Err(row.wrong(what.unwrap_or(event), words));
        }
        let side = match row.text(of_cause) {
            "output" => 0,
            "trigger" => 1,
            // The probe's and the encoders' own latches are nothing to a scan; a loss may be of no cause.
            other @ ("skip" | "skip_end" | "index" | "") => {
                others.insert(other.to_owned());
                continue;
            }
            _ => return Err(row.wrong(of_cause, "output, trigger, skip, skip_end or index")),
        };
        match row.text(event) {
            "loss" => {
                let rows: u64 = row.integer(lost)?;
                missed[side] = missed[side].saturating_add(rows);
                if side == 1 || !row.text(number).is_empty() {
                    run[side] = run[side].saturating_add(rows);
                }
            }
            "latch" => {
                let mut latch = TriggerLatch {
                    number: row.integer(number)?,
                    t_ns: row.integer(t_ns)?,
                    counts: [None; COLUMNS.len()],
                };
                for (place, column) in counts.iter().enumerate() {
                    if let Some(column) = *column
                        && !row.text(column).is_empty()
                    {
                        latch.counts[place] = Some(row.integer(column)?);
                    }
                }
                if let Some(before) = latches[side].last()
                    && (latch.number <= before.number || latch.t_ns <= before.t_ns)
                {
                    return Err(restarted(&name, row.line(), before, &latch));
                }
                latches[side].push(latch);
                lost_runs[side].extend(Some(std::mem::take(&mut run[side])).filter(|&run| run > 0));
            }
            _ => return Err(row.wrong(event, "latch or loss")),
        }
    }
    let side = match cause {
        Some(LatchSignal::Output) => 0,
        Some(LatchSignal::Trigger) => 1,
        None if latches.iter().all(|latches| !latches.is_empty()) => {
            return Err(ScanError::refused(
                "which_cause",
                format_args!(
                    "{name} has latches of the board's pulses and of the sensor's: say with \
                     --cause output or --cause trigger which ones belong to the profiles"
                ),
            ));
        }
        None => usize::from(latches[0].is_empty()),
    };
    let asked = cause;
    let cause = [LatchSignal::Output, LatchSignal::Trigger][side];
    let [output, trigger] = latches;
    let latches = if side == 0 { output } else { trigger };
    let mut lost_runs = std::mem::take(&mut lost_runs[side]);
    lost_runs.extend(Some(run[side]).filter(|&run| run > 0));
    if latches.is_empty() {
        let which = asked.map_or("output or trigger", LatchSignal::name);
        let others = others.into_iter().collect::<Vec<_>>().join(", ");
        return Err(ScanError::refused(
            "no_triggers",
            format_args!(
                "{name} has no latch of the cause {which}{}",
                if others.is_empty() {
                    String::new()
                } else {
                    format!("; there are others: {others}")
                }
            ),
        ));
    }
    Ok(Triggers {
        cause,
        latches,
        missed: missed[side],
        lost_runs,
        right_until_ns,
    })
}

fn restarted(name: &str, line: u64, before: &TriggerLatch, latch: &TriggerLatch) -> ScanError {
    ScanError::refused(
        "board_restarted",
        format_args!(
            "{name}, line {line}: latch {} at {} ns stands behind latch {} at {} ns: the board \
             was restarted in the middle of the scan, or two tables were joined",
            latch.number, latch.t_ns, before.number, before.t_ns
        ),
    )
    .with("line", line)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "event,number,cause,t_ns,x_counts,w_counts,lost\n";

    fn read(rows: &str, cause: Option<LatchSignal>) -> Result<Triggers, ScanError> {
        let text = format!("{HEADER}{rows}");
        parse(
            TableReader::new(text.as_bytes(), "t".into()).unwrap(),
            cause,
        )
    }

    #[test]
    fn losses_of_both_kinds_are_summed_for_their_cause_only() {
        let rows = "latch,0,output,1000,5,,0\nloss,1,output,,,,3\nlatch,4,output,2000,6,,0\n\
                    loss,,output,,,,2\nlatch,5,output,3000,7,,0\nloss,,trigger,,,,9\n\
                    latch,0,skip,1,,,0\n";
        let triggers = read(rows, None).unwrap();
        assert_eq!(triggers.cause, LatchSignal::Output);
        assert_eq!(triggers.latches.len(), 3);
        assert_eq!(triggers.missed, 5);
        // Lines that never had a pulse are no run.
        assert_eq!(triggers.lost_runs, [3]);
        assert_eq!(
            triggers.latches[1].counts,
            [Some(6), None, None, None, None, None]
        );
    }

    #[test]
    fn lost_motion_says_until_when_counts_are_right() {
        let text = "event,number,cause,t_ns,x_counts,lost,what\n\
            latch,0,output,1000,5,0,\nlatch,1,output,2000,5,0,\nloss,2,output,2500,,1,latches\n\
            latch,3,output,3000,5,0,\nloss,,,2000,,4,transitions\nloss,,,2500,,1,motion\n";
        let table = TableReader::new(text.as_bytes(), "t".into()).unwrap();
        let triggers = parse(table, None).unwrap();
        assert_eq!((triggers.missed, triggers.right_until_ns), (1, Some(2000)));
        assert_eq!((triggers.latches.len(), triggers.right()), (3, 2));
        assert_eq!(read("latch,0,output,1000,5,,0\n", None).unwrap().right(), 1);
    }

    #[test]
    fn what_is_no_scan_is_refused_by_name() {
        let both = "latch,0,output,1000,5,,0\nlatch,0,trigger,1000,5,,0\n";
        let code = |rows, cause| read(rows, cause).unwrap_err().code;
        assert_eq!(code(both, None), "which_cause");
        assert_eq!(
            read(both, Some(LatchSignal::Trigger)).unwrap().cause,
            LatchSignal::Trigger
        );
        assert_eq!(code("", None), "no_triggers");
        assert_eq!(code("latch,0,skip,1,,,0\n", None), "no_triggers");
        assert_eq!(
            code("latch,0,trigger,1,,,0\n", Some(LatchSignal::Output)),
            "no_triggers"
        );
        // What no board writes was damaged: a latch that is passed over would leave its profile to its neighbour.
        assert_eq!(code("latch,0,outptu,1,5,,0\n", None), "corrupt");
        // A loss of something that is not known may be one of motion.
        let text = "event,number,cause,t_ns,x_counts,lost,what\nloss,,output,,,3,WORD\nlatch,0,output,1000,5,0,\n";
        let told = |word: &str| {
            let text = text.replace("WORD", word);
            let table = TableReader::new(text.as_bytes(), "t".into()).unwrap();
            parse(table, None).map(|triggers| triggers.missed)
        };
        assert_eq!(told("edges").unwrap(), 3);
        assert_eq!(told("encoder").unwrap_err().code, "corrupt");
        let again = "latch,7,output,1000,5,,0\nlatch,0,output,2000,5,,0\n";
        assert_eq!(code(again, None), "board_restarted");
    }
}
