//! Latches and losses as rows of a table: what `umi events --csv` and a recording of a scan write.

use umi_protocol::latch::LatchCause;

use super::{Loss, Lost, TimelineEntry};
use crate::axes::{NAMES, Scale};

/// The first line. Documented in the help of `umi events`.
pub const HEADER: &str = "event,number,cause,t_ns,x_counts,y_counts,z_counts,w_counts,\
    axis5_counts,axis6_counts,x_mm,y_mm,z_mm,lost,what\n";

/// A latch or a loss as a line; of anything else nothing.
#[must_use]
pub fn row(entry: &TimelineEntry, scale: &Scale) -> String {
    match entry {
        TimelineEntry::Latch(_, latch) => {
            let mut cells = vec![
                "latch".into(),
                latch.number.to_string(),
                name(latch.cause).into(),
                latch.t_ns.to_string(),
            ];
            let counts = |axis| latch.counts.get(axis).copied();
            cells.extend((0..NAMES.len()).map(|axis| cell(counts(axis))));
            let mm = |axis| scale.mm(axis, counts(axis)?);
            cells.extend((0..3).map(|axis| cell(mm(axis).map(|mm| format!("{mm:.6}")))));
            cells.push("0,".into());
            cells.join(",") + "\n"
        }
        TimelineEntry::Loss(Loss { what, count, t_ns }) => {
            let (number, cause) = match what {
                Lost::Edges(cause) => (None, Some(*cause)),
                Lost::Latches(cause, first) => (Some(*first), Some(*cause)),
                Lost::Counted | Lost::Events | Lost::Motion | Lost::Transitions => (None, None),
                // Not of a table of latches.
                Lost::Bytes => return String::new(),
            };
            let nothing = ",".repeat(NAMES.len() + 3);
            format!(
                "loss,{},{},{}{nothing},{count},{}\n",
                cell(number),
                cell(cause.map(name)),
                cell(*t_ns),
                what.code()
            )
        }
        _ => String::new(),
    }
}

const fn name(cause: LatchCause) -> &'static str {
    match cause {
        LatchCause::Skip => "skip",
        LatchCause::Trigger => "trigger",
        LatchCause::Output => "output",
        LatchCause::Index { .. } => "index",
        LatchCause::SkipEnd => "skip_end",
    }
}

fn cell(value: Option<impl ToString>) -> String {
    value.map_or(String::new(), |value| value.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use umi_protocol::latch::LatchReport;

    #[test]
    fn a_row_has_as_many_cells_as_the_header() {
        let latch = LatchReport {
            number: 7,
            cause: LatchCause::SkipEnd,
            counts: [-1, 2].into_iter().collect(),
            t_ns: 5,
            missed: 0,
        };
        let loss = |what| {
            TimelineEntry::Loss(Loss {
                what,
                count: 3,
                t_ns: Some(9),
            })
        };
        let entries = [
            TimelineEntry::Latch(None, latch),
            loss(Lost::Latches(LatchCause::Output, 4)),
            loss(Lost::Motion),
        ];
        let rows = entries.map(|entry| row(&entry, &Scale::default()));
        assert_eq!(
            rows,
            [
                "latch,7,skip_end,5,-1,2,,,,,,,,0,\n",
                "loss,4,output,9,,,,,,,,,,3,latches\n",
                "loss,,,9,,,,,,,,,,3,motion\n"
            ]
        );
        let cells = |line: &str| line.matches(',').count();
        assert!(rows.iter().all(|row| cells(row) == cells(HEADER)));
        assert_eq!(row(&loss(Lost::Bytes), &Scale::default()), "");
    }
}
