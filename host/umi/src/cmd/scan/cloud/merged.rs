//! What a merge or a pairing has lost, from the object that it printed.

use std::path::Path;

use serde::Deserialize;
use umi_report::pages::scan::FigureTable;
use umi_scan::ScanError;
use umi_scan::merge::Merged;

/// Places of lost frames that a table shows.
const PLACES: usize = 40;

/// What `umi scan merge --json` or `umi scan pair --json` says was lost or left out.
#[derive(Deserialize)]
pub struct MergeLosses {
    pairs: Vec<Paired>,
    unpaired_profiles: Vec<u64>,
    duplicates: Vec<u64>,
    unpaired_triggers: Vec<u64>,
    /// Of a merge that stopped at a loss of motion.
    #[serde(default)]
    behind_loss: Vec<u64>,
    /// Numbers that are missing between the first and the last of the frame counter.
    pub lost_frames: u64,
    missed_latches: u64,
    warnings: Vec<String>,
    profiles: Option<u64>,
    points: Option<u64>,
    invalid: Option<u64>,
}

#[derive(Deserialize)]
struct Paired {
    profile: u64,
    frame: u64,
    number: u64,
}

impl MergeLosses {
    /// Reads the object.
    ///
    /// # Errors
    /// `bad_file` where the file is none of the two.
    pub fn read(path: &Path) -> Result<Self, ScanError> {
        let text =
            std::fs::read_to_string(path).map_err(|error| ScanError::file("read", path, &error))?;
        serde_json::from_str(&text).map_err(|error| {
            ScanError::unreadable(
                "bad_file",
                format_args!(
                    "{}: {error}. What `umi scan merge --json` prints is needed",
                    path.display()
                ),
            )
        })
    }

    /// Of a merge that this program has made.
    ///
    /// # Errors
    /// None is known: the object is that of [`Self::read`].
    pub fn of(merged: &Merged) -> Result<Self, ScanError> {
        serde_json::to_value(merged)
            .and_then(serde_json::from_value)
            .map_err(|error| ScanError::unreadable("json", format_args!("no JSON: {error}")))
    }

    /// What was lost, and where frames have no points.
    pub fn tables(&self) -> Vec<FigureTable> {
        let count = |name: &str, value: Option<u64>| {
            value.map(|value| vec![name.to_owned(), value.to_string()])
        };
        let some = |numbers: &[u64]| Some(numbers.len() as u64);
        let rows = [
            ("profiles read", self.profiles),
            ("profiles with a latch", Some(self.pairs.len() as u64)),
            ("points", self.points),
            ("samples without range", self.invalid),
            (
                "frames lost by the sensor's counter",
                Some(self.lost_frames),
            ),
            (
                "profiles without latch, left out",
                some(&self.unpaired_profiles),
            ),
            (
                "profiles behind a loss of motion, left out",
                (!self.behind_loss.is_empty()).then_some(self.behind_loss.len() as u64),
            ),
            ("profiles that came again, left out", some(&self.duplicates)),
            ("latches without profile", some(&self.unpaired_triggers)),
            ("latches missed or not told", Some(self.missed_latches)),
        ];
        let lost = FigureTable {
            caption: "What the merge says of its streams".into(),
            heads: vec!["what", "number"],
            rows: rows.into_iter().filter_map(|(n, v)| count(n, v)).collect(),
        };
        // In the order of the latches: profiles may have come misplaced.
        let mut pairs: Vec<&Paired> = self.pairs.iter().collect();
        pairs.sort_by_key(|pair| pair.number);
        let gaps: Vec<(u64, u64, u64)> = pairs
            .windows(2)
            .filter_map(|pair| {
                let missing = pair[1].frame.checked_sub(pair[0].frame)?.checked_sub(1)?;
                (missing > 0).then_some((pair[0].profile, pair[0].frame, missing))
            })
            .collect();
        let more = match gaps.len().saturating_sub(PLACES) {
            0 => String::new(),
            more => format!("; {more} more places are not shown"),
        };
        let places = FigureTable {
            caption: format!("Where frames have no points{more}"),
            heads: vec!["after profile", "frame", "frames without points"],
            rows: gaps
                .iter()
                .take(PLACES)
                .map(|(profile, frame, missing)| {
                    vec![profile.to_string(), frame.to_string(), missing.to_string()]
                })
                .collect(),
        };
        [lost, places]
            .into_iter()
            .filter(|table| !table.rows.is_empty())
            .collect()
    }

    /// What must be known, a line each.
    pub fn remarks(&self) -> Vec<String> {
        let mut remarks = Vec::new();
        if self.lost_frames > 0 {
            remarks.push(format!(
                "Frames lost: {}. Where they would lie, the maps have holes or fewer points.",
                self.lost_frames
            ));
        }
        if self.missed_latches > 0 {
            remarks.push(format!(
                "Latches missed: {}. Their profiles were left out.",
                self.missed_latches
            ));
        }
        remarks.extend(self.warnings.iter().cloned());
        remarks
    }
}
