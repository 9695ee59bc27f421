//! The file that lists scans of one part, and by what it had been moved in each.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use umi_scan::ScanError;
use umi_scan::rigid::{Pose, pose_of_rows};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    scan: Vec<Entry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    file: PathBuf,
    moved: Option<Moved>,
    #[serde(default)]
    carried: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Moved {
    rotation: [[f64; 3]; 3],
    translation_mm: [f64; 3],
}

/// A scan of the list.
pub struct Listed {
    pub file: PathBuf,
    pub moved: Pose,
    pub carried: bool,
}

impl Listed {
    /// A scan of a part that nobody has moved.
    pub fn still(file: &Path) -> Self {
        Self {
            file: file.to_owned(),
            moved: Pose::identity(),
            carried: false,
        }
    }
}

/// Reads the list; the scans are found beside it.
pub fn read(path: &Path) -> Result<Vec<Listed>, ScanError> {
    let text =
        std::fs::read_to_string(path).map_err(|error| ScanError::file("read", path, &error))?;
    let bad = |what: &dyn std::fmt::Display| {
        ScanError::unreadable("bad_file", format_args!("{}: {what}", path.display()))
    };
    let file: File = toml::from_str(&text).map_err(|error| bad(&error))?;
    if file.scan.is_empty() {
        return Err(bad(&"no [[scan]] is in it"));
    }
    file.scan
        .into_iter()
        .map(|entry| {
            let moved = match &entry.moved {
                None => Pose::identity(),
                Some(m) => pose_of_rows(&m.rotation, &m.translation_mm).ok_or_else(|| {
                    bad(&format_args!(
                        "{}: moved is {{ rotation = three rows that turn and do not mirror, translation_mm = three numbers }}",
                        entry.file.display()
                    ))
                })?,
            };
            Ok(Listed {
                file: path.parent().unwrap_or(Path::new("")).join(&entry.file),
                moved,
                carried: entry.carried,
            })
        })
        .collect()
}
