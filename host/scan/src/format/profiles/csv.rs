//! Profiles as CSV: `profile,frame,t_us,encoder,index,x_mm,z_mm`.
//!
//! A row per sample with a range; one row with the last three empty for a profile without
//! any. The rows of a profile stand together. A column `intensity` may stand beside them: how bright the sample
//! was, in the sensor's own measure. It is read only where that is asked for.

use std::io::BufRead;

use super::super::table::TableReader;
use super::Depth;
use crate::ScanError;
use crate::profile::{Profile, ProfilePoint, Stamp};

/// Comparisons for the indices of a profile that do not rise: 30 000 samples from last to first.
const MOST_DISORDER: usize = 450_000_000;

/// Hands out every profile of the table.
///
/// # Errors
/// `corrupt` where rows of one profile disagree or do not stand together, those of the
/// table, or what `take` refuses.
pub fn visit<R: BufRead>(
    mut table: TableReader<R>,
    depth: Depth,
    mut take: impl FnMut(&Profile<'_>) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    let profile = table.column("profile")?;
    let frame = table.column("frame")?;
    let t_us = table.column("t_us")?;
    let encoder = table.optional("encoder");
    let index = table.column("index")?;
    let x_mm = table.column("x_mm")?;
    let z_mm = table.column("z_mm")?;
    let intensity = (depth == Depth::Intensities)
        .then(|| table.optional("intensity"))
        .flatten();

    let mut current: Option<Stamp> = None;
    let mut samples: Vec<ProfilePoint> = Vec::new();
    let mut bright: Vec<f64> = Vec::new();
    let mut disorder = 0;
    while let Some(row) = table.next_row()? {
        let stamp = Stamp {
            profile: row.integer(profile)?,
            frame: row.integer(frame)?,
            t_us: row.finite(t_us)?,
            encoder: match encoder {
                Some(column) if !row.text(column).is_empty() => Some(row.integer(column)?),
                _ => None,
            },
        };
        match current {
            Some(before) if before == stamp => {}
            Some(before) if before.profile == stamp.profile => {
                return Err(row.wrong(profile, "the frame, time and encoder of its profile"));
            }
            Some(before) => {
                if stamp.profile < before.profile {
                    return Err(row.wrong(profile, "a profile behind the one before"));
                }
                let intensities = intensity.map(|_| &*bright);
                hand_out(before, &samples, intensities, &mut take)?;
                samples.clear();
                bright.clear();
                disorder = 0;
            }
            None => {}
        }
        current = Some(stamp);
        let cells = [index, x_mm, z_mm].map(|column| row.text(column).is_empty());
        if cells == [true; 3] {
            continue;
        }
        let sample = ProfilePoint {
            index: row.integer(index)?,
            x_mm: row.finite(x_mm)?,
            z_mm: row.finite(z_mm)?,
        };
        // Mostly they rise; where they do not, each is looked for.
        if samples
            .last()
            .is_some_and(|last| sample.index <= last.index)
        {
            let known = samples.iter().any(|before| before.index == sample.index);
            disorder += samples.len();
            if known || disorder > MOST_DISORDER {
                return Err(row.wrong(index, "each place of the sensor's array once, rising"));
            }
        }
        samples.push(sample);
        if let Some(column) = intensity {
            bright.push(row.finite(column)?);
        }
    }
    match current {
        Some(stamp) => hand_out(stamp, &samples, intensity.map(|_| &*bright), &mut take),
        None => Ok(()),
    }
}

fn hand_out(
    stamp: Stamp,
    samples: &[ProfilePoint],
    intensities: Option<&[f64]>,
    take: &mut impl FnMut(&Profile<'_>) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    take(&Profile {
        stamp,
        samples,
        intensities,
        invalid: 0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "profile,frame,t_us,encoder,index,x_mm,z_mm\n";

    fn read(rows: &str) -> Result<Vec<(Stamp, usize)>, ScanError> {
        let text = format!("{HEADER}{rows}");
        let mut profiles = Vec::new();
        visit(
            TableReader::new(text.as_bytes(), "p".into()).unwrap(),
            Depth::Samples,
            |profile| {
                profiles.push((profile.stamp, profile.samples.len()));
                Ok(())
            },
        )?;
        Ok(profiles)
    }

    #[test]
    fn a_profile_without_range_is_one_all_the_same() {
        let profiles = read("0,5,1.5,,0,1.0,2.0\n0,5,1.5,,3,1.5,2.5\n1,6,9.5,-7,,,\n").unwrap();
        assert_eq!(profiles.len(), 2);
        assert_eq!((profiles[0].1, profiles[1].1), (2, 0));
        assert_eq!(profiles[1].0.encoder, Some(-7));
        // From last to first, and the same indices in the next profile.
        let profiles =
            read("0,5,1.5,,3,1.0,2.0\n0,5,1.5,,1,1.5,2.5\n1,6,2.5,,3,1.0,2.0\n").unwrap();
        assert_eq!((profiles[0].1, profiles[1].1), (2, 1));
    }

    /// Each sample keeps its own, in the order of the rows; without the question the column is not looked at, so that
    /// what was read before still is.
    #[test]
    fn intensities_stand_by_their_samples_where_they_are_asked_for() {
        let read = |text: &str, depth| {
            let mut all = Vec::new();
            let table = TableReader::new(text.as_bytes(), "p".into())?;
            visit(table, depth, |profile| {
                let places: Vec<u32> = profile.samples.iter().map(|s| s.index).collect();
                all.push((places, profile.intensities.map(<[f64]>::to_vec)));
                Ok(())
            })
            .map(|()| all)
        };
        let text = "profile,frame,t_us,intensity,index,x_mm,z_mm\n0,5,1.5,7.5,3,1.0,2.0\n0,5,1.5,200,1,1.5,2.5\n\
                    1,6,9.5,,,,\n2,7,19.5,0,3,1.0,2.0\n";
        let all = read(text, Depth::Intensities).unwrap();
        let due = [
            (vec![3, 1], Some(vec![7.5, 200.0])),
            (vec![], Some(vec![])),
            (vec![3], Some(vec![0.0])),
        ];
        assert_eq!(all, due);
        let all = read(text, Depth::Samples).unwrap();
        assert!(all.iter().all(|(_, bright)| bright.is_none()));
        // A sample without its own is none that is 0.
        let cut = text.replace("7.5", "");
        assert_eq!(read(&cut, Depth::Intensities).unwrap_err().code, "corrupt");
        assert!(read(&cut, Depth::Samples).is_ok());
        // A file without the column says nothing.
        let bare = "profile,frame,t_us,index,x_mm,z_mm\n0,5,1.5,3,1.0,2.0\n";
        assert_eq!(read(bare, Depth::Intensities).unwrap()[0].1, None);
    }

    #[test]
    fn rows_that_contradict_are_not_understood() {
        for rows in [
            "0,5,1.5,,0,1.0,2.0\n0,6,1.5,,1,1.0,2.0\n",
            "1,5,1.5,,0,1.0,2.0\n0,6,2.5,,1,1.0,2.0\n",
            "0,5,1.5,,0,1.0,\n",
            "0,5,1.5,,3,1.0,2.0\n0,5,1.5,,3,1.1,2.0\n",
            "0,5,1.5,,3,1.0,2.0\n0,5,1.5,,4,1.0,2.0\n0,5,1.5,,3,1.1,2.0\n",
        ] {
            assert_eq!(read(rows).unwrap_err().code, "corrupt", "{rows}");
        }
        assert_eq!(read("0,5,1.5,,0,nan,1.0\n").unwrap_err().code, "not_finite");
        // Cut between two cells, and within the last number.
        for cut in ["0,5,1.5,,0", "0,5,1.5,,0,1.0,2."] {
            assert_eq!(read(cut).unwrap_err().code, "truncated", "{cut}");
        }
    }
}
