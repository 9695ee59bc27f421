//! Transforms and points as the commands of this group read and write them.

use std::path::Path;

use serde_json::{Map, Value, json};
use umi_scan::ScanError;
use umi_scan::rigid::{Pose, pose_of_rows, rows};

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

/// Writes the transform for `umi correction --transform` and `umi nc rewrite --transform`, which
/// take none whose verdict is NG.
pub fn write(path: &Path, motion: &Pose, verdict: &str) -> Result<(), ScanError> {
    let mut map = fields(motion);
    map.insert("verdict".into(), verdict.into());
    std::fs::write(path, format!("{}\n", Value::Object(map)))
        .map_err(|error| ScanError::file("write", path, &error))
}

/// Three numbers, as `250,0,40`.
pub fn point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|x| x.trim().parse()).collect();
    let point: Option<[f64; 3]> = numbers.ok().and_then(|list| list.try_into().ok());
    point
        .filter(|p| p.iter().all(|x| x.is_finite()))
        .ok_or_else(|| "give three numbers in mm, as 250,0,40".into())
}
