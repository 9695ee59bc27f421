//! Transforms and points as the commands of this group read and write them.

use std::path::Path;

use clap::{Args, ValueEnum};
use serde_json::{Map, Value, json};
use umi_scan::ScanError;
use umi_scan::localise::Certainty;
use umi_scan::rigid::{Pose, is_in_reach, pose_of_rows, rows};

/// Reads `{"rotation": [[…], […], […]], "translation_mm": […]}`.
pub fn read(path: &Path) -> Result<Pose, ScanError> {
    let bad =
        |what: &str| ScanError::unreadable("bad_file", format_args!("{}: {what}", path.display()));
    let text =
        std::fs::read_to_string(path).map_err(|error| ScanError::file("read", path, &error))?;
    let value: Value = serde_json::from_str(&text).map_err(|error| bad(&error.to_string()))?;
    parse(&value).ok_or_else(|| {
        bad("a transform is {\"rotation\": [[1,0,0],[0,1,0],[0,0,1]], \"translation_mm\": [0,0,0]} with a rotation that turns and does not mirror")
    })
}

fn parse(value: &Value) -> Option<Pose> {
    let three = |value: &Value| -> Option<[f64; 3]> {
        let list = value.as_array().filter(|list| list.len() == 3)?;
        Some([list[0].as_f64()?, list[1].as_f64()?, list[2].as_f64()?])
    };
    let rows = value["rotation"]
        .as_array()
        .filter(|rows| rows.len() == 3)?;
    let rows = [three(&rows[0])?, three(&rows[1])?, three(&rows[2])?];
    pose_of_rows(&rows, &three(&value["translation_mm"])?)
}

/// The fields `rotation` and `translation_mm`.
pub fn fields(motion: &Pose) -> Map<String, Value> {
    let mut map = Map::new();
    map.insert("rotation".into(), json!(rows(&motion.rotation)));
    map.insert(
        "translation_mm".into(),
        json!(motion.translation_mm.as_slice()),
    );
    map
}

/// From which coordinates into which a transform carries, as its file says it.
#[derive(Debug, Clone, Copy)]
pub struct FromTo {
    pub from: &'static str,
    pub to: &'static str,
}

impl FromTo {
    /// Where the scanner stands.
    pub const SCANNER: Self = Self {
        from: "scanner",
        to: "machine",
    };
    /// Where the part lies, by fiducials.
    pub const PART_ON_MACHINE: Self = Self {
        from: "part",
        to: "machine",
    };

    /// The fields `from` and `to`.
    pub fn put(self, map: &mut Map<String, Value>) {
        map.insert("from".into(), self.from.into());
        map.insert("to".into(), self.to.into());
    }
}

/// What the numbers of a scan are.
#[derive(Args)]
pub struct ScanFrame {
    /// Whose coordinates the scan has, as -o writes it: those of the work offset in which the program
    /// runs, or the machine's. Without it `umi correction` and `umi nc rewrite` take no transform of it
    #[arg(long, value_enum)]
    scan_in: Option<ScanIn>,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ScanIn {
    Offset,
    Machine,
}

impl ScanFrame {
    /// Whether somebody has said it.
    pub const fn is_said(&self) -> bool {
        self.scan_in.is_some()
    }

    /// What a transform carries that leads from the part into the scan.
    pub const fn of_part(&self) -> FromTo {
        let to = match self.scan_in {
            None => "scan",
            Some(ScanIn::Offset) => "offset",
            Some(ScanIn::Machine) => "machine",
        };
        FromTo { from: "part", to }
    }
}

/// Writes the transform for `umi correction --transform` and `umi nc rewrite --transform`, which
/// take none whose verdict is NG, and none of which nobody says whose coordinates it leads to. What its covariance
/// says is held there where the part or the program ends.
pub fn write(
    path: &Path,
    motion: &Pose,
    frames: FromTo,
    verdict: &str,
    certainty: Option<&Certainty>,
) -> Result<(), ScanError> {
    let mut map = fields(motion);
    frames.put(&mut map);
    map.insert("verdict".into(), verdict.into());
    let known = |c: &&Certainty| c.cov.iter().all(|x| x.is_finite());
    if let Some(certainty) = certainty.filter(known) {
        map.insert("cov".into(), json!(rows(&certainty.cov)));
    }
    std::fs::write(path, format!("{}\n", Value::Object(map)))
        .map_err(|error| ScanError::file("write", path, &error))
}

/// Three numbers, as `250,0,40`.
pub fn point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|x| x.trim().parse()).collect();
    let point: Option<[f64; 3]> = numbers.ok().and_then(|list| list.try_into().ok());
    point
        .filter(|p| is_in_reach(&(*p).into()))
        .ok_or_else(|| "give three numbers in mm, as 250,0,40, none beyond 1e9".into())
}
