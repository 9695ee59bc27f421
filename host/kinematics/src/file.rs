//! The machine file: TOML, as a person writes it.
//!
//! ```toml
//! [[joint]]
//! name = "C"
//! kind = "rotary"                 # or "linear"
//! direction = [0.0, 0.0, 1.0]     # machine frame, all joints at 0; any length
//! point_mm = [0.0, 0.0, 0.0]      # rotary: any point of the axis
//! column = "axis5"                # the board's input: x y z w axis5 axis6
//! counts_per_deg = 10000.0        # linear: counts_per_mm; negative counts down
//! origin_counts = 0
//! # or, without an encoder: value = 15.0
//!
//! [chain]                         # from the machine's base outwards
//! sensor = ["X", "Y", "Z"]
//! workpiece = ["A", "C"]
//!
//! [sensor]                        # X; [workpiece] is W; the identity where missing
//! rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
//! translation_mm = [0, 0, 0]
//! # covariance = [[...6], ...6]   # of [sensor] alone, from a calibration: wx wy wz tx ty tz
//! ```

use nalgebra::{Matrix6, Vector3};
use serde::Deserialize;

use crate::{AxisChain, COLUMNS, Drive, Joint, JointKind, MachineError, Pose};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileText {
    #[serde(default)]
    joint: Vec<JointText>,
    chain: ChainText,
    sensor: Option<FrameText>,
    workpiece: Option<FrameText>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct JointText {
    name: String,
    kind: String,
    direction: [f64; 3],
    point_mm: Option<[f64; 3]>,
    column: Option<String>,
    counts_per_mm: Option<f64>,
    counts_per_deg: Option<f64>,
    origin_counts: Option<f64>,
    value: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ChainText {
    #[serde(default)]
    sensor: Vec<String>,
    #[serde(default)]
    workpiece: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FrameText {
    #[serde(default = "identity_rows")]
    rotation: [[f64; 3]; 3],
    #[serde(default)]
    translation_mm: [f64; 3],
    covariance: Option<[[f64; 6]; 6]>,
}

fn identity_rows() -> [[f64; 3]; 3] {
    Pose::identity().rows()
}

impl AxisChain {
    /// Reads a machine file.
    ///
    /// # Errors
    /// What is wrong, by the name of the joint or table.
    pub fn parse(text: &str) -> Result<Self, MachineError> {
        let file: FileText = toml::from_str(text)
            .map_err(|error| MachineError::unreadable(error.to_string().trim().to_owned()))?;
        let mut joints: Vec<Joint> = Vec::with_capacity(file.joint.len());
        for text in &file.joint {
            if joints.iter().any(|joint| joint.name == text.name) {
                return Err(MachineError::wrong(format!(
                    "two joints have the name {:?}",
                    text.name
                )));
            }
            joints.push(joint(text)?);
        }
        let sensor_chain = chain("sensor", &file.chain.sensor, &joints)?;
        let workpiece_chain = chain("workpiece", &file.chain.workpiece, &joints)?;
        if let Some(&both) = sensor_chain.iter().find(|p| workpiece_chain.contains(p)) {
            return Err(MachineError::wrong(format!(
                "joint {:?} is in both chains: an axis carries the sensor or the workpiece",
                joints[both].name
            )));
        }
        Ok(Self {
            sensor_chain,
            workpiece_chain,
            sensor: frame("sensor", file.sensor.as_ref())?,
            sensor_covariance: covariance(&file)?,
            workpiece: frame("workpiece", file.workpiece.as_ref())?,
            joints,
        })
    }
}

fn joint(text: &JointText) -> Result<Joint, MachineError> {
    let wrong = |what: &str| MachineError::wrong(format!("joint {:?}: {what}", text.name));
    if text.name.is_empty() {
        return Err(wrong("a joint needs a name"));
    }
    let kind = match text.kind.as_str() {
        "linear" => JointKind::Linear,
        "rotary" => JointKind::Rotary,
        other => {
            return Err(wrong(&format!(
                "kind {other:?} is unknown: \"linear\" or \"rotary\""
            )));
        }
    };
    let direction = Vector3::from(text.direction);
    // By the largest component first, so that neither large nor small ones overflow.
    let largest = direction.amax();
    if !direction.iter().all(|v| v.is_finite()) || largest == 0.0 {
        return Err(wrong("direction needs a length above 0"));
    }
    let direction = (direction / largest).normalize();
    let point_mm = match (kind, text.point_mm) {
        (JointKind::Rotary, None) => {
            return Err(wrong("a rotary axis needs point_mm, any point on it"));
        }
        (_, point) => Vector3::from(point.unwrap_or_default()),
    };
    if !point_mm.iter().all(|v| v.is_finite()) {
        return Err(wrong("point_mm is not finite"));
    }
    Ok(Joint {
        name: text.name.clone(),
        kind,
        direction,
        point_mm,
        drive: drive(text, kind).map_err(|what| wrong(&what))?,
    })
}

fn drive(text: &JointText, kind: JointKind) -> Result<Drive, String> {
    let (scale, name, other) = match kind {
        JointKind::Linear => (text.counts_per_mm, "counts_per_mm", text.counts_per_deg),
        JointKind::Rotary => (text.counts_per_deg, "counts_per_deg", text.counts_per_mm),
    };
    if other.is_some() {
        return Err(format!("an axis of this kind has {name}"));
    }
    let Some(column) = &text.column else {
        if scale.is_some() || text.origin_counts.is_some() {
            return Err(format!(
                "counts without an input: column is missing, one of {}",
                COLUMNS.join(" ")
            ));
        }
        return match text.value {
            Some(value) if !value.is_finite() => Err("value is not finite".into()),
            Some(value) => Ok(Drive::Constant(value)),
            None => Ok(Drive::Named),
        };
    };
    if text.value.is_some() {
        return Err("either column or value, not both".into());
    }
    let column = COLUMNS
        .into_iter()
        .find(|known| known == column)
        .ok_or_else(|| {
            format!(
                "a board has no axis {column:?}: one of {}",
                COLUMNS.join(" ")
            )
        })?;
    let counts_per_unit =
        scale.ok_or_else(|| format!("counts without scale: {name} is missing"))?;
    if !counts_per_unit.is_finite() || counts_per_unit == 0.0 {
        return Err(format!("{name} needs a number other than 0"));
    }
    let origin_counts = text.origin_counts.unwrap_or(0.0);
    if !origin_counts.is_finite() {
        return Err("origin_counts is not finite".into());
    }
    Ok(Drive::Encoder {
        column,
        counts_per_unit,
        origin_counts,
    })
}

fn chain(side: &str, names: &[String], joints: &[Joint]) -> Result<Vec<usize>, MachineError> {
    let mut places = Vec::with_capacity(names.len());
    for name in names {
        let place = joints
            .iter()
            .position(|joint| joint.name == *name)
            .ok_or_else(|| {
                MachineError::wrong(format!("chain.{side} names {name:?}, which is no joint"))
            })?;
        if places.contains(&place) {
            return Err(MachineError::wrong(format!(
                "chain.{side} names {name:?} twice"
            )));
        }
        places.push(place);
    }
    Ok(places)
}

fn frame(name: &str, text: Option<&FrameText>) -> Result<Pose, MachineError> {
    text.map_or(Ok(Pose::identity()), |text| {
        Pose::from_rows(&text.rotation, &text.translation_mm)
            .map_err(|what| MachineError::wrong(format!("[{name}] {what}")))
    })
}

/// The covariance of the mount, if it is one.
fn covariance(file: &FileText) -> Result<Option<[[f64; 6]; 6]>, MachineError> {
    if file
        .workpiece
        .as_ref()
        .is_some_and(|w| w.covariance.is_some())
    {
        return Err(MachineError::wrong(
            "[workpiece] has no covariance: only [sensor] has",
        ));
    }
    let Some(c) = file.sensor.as_ref().and_then(|sensor| sensor.covariance) else {
        return Ok(None);
    };
    for i in 0..6 {
        for k in 0..6 {
            let bound = (c[i][i] * c[k][k]).sqrt() * (1.0 + 1e-6);
            let fits = c[i][i] >= 0.0 && c[i][k].abs() <= bound && c[i][k] == c[k][i];
            if !fits {
                return Err(MachineError::wrong(format!(
                    "[sensor] covariance: row {}, column {} does not belong to a covariance",
                    i + 1,
                    k + 1
                )));
            }
        }
    }
    // Each pair may fit, and all together give a sum of them a variance below 0. By correlations, what is held as it is.
    let correlation = Matrix6::from_fn(|i, k| match (i == k, (c[i][i] * c[k][k]).sqrt()) {
        (true, _) => 1.0 + 1e-6,
        (false, 0.0) => 0.0,
        (false, both) => c[i][k] / both,
    });
    if correlation.cholesky().is_none() {
        return Err(MachineError::wrong(
            "[sensor] covariance: its rows contradict each other, some sum of the six would have a variance below 0",
        ));
    }
    Ok(Some(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"
[[joint]]
name = "X"
kind = "linear"
direction = [2.0, 0.0, 0.0]
column = "x"
counts_per_mm = -1000.0
origin_counts = 500

[[joint]]
name = "C"
kind = "rotary"
direction = [0, 0, 1]
point_mm = [10.0, 0.0, 0.0]
value = 90.0

[chain]
sensor = ["X"]
workpiece = ["C"]
"#;

    #[test]
    fn counts_and_constants_become_a_pose() {
        let machine = AxisChain::parse(GOOD).unwrap();
        let x = machine.joints[0].value(-1500.0).unwrap();
        assert_eq!(x, 2.0);
        let c = machine.joints[1].constant().unwrap();
        // The sensor at x = 2 stands 8 mm left of the axis; seen from the turned table, below.
        let pose = machine.sensor_in_workpiece(&[x, c]);
        let expected = Vector3::new(10.0, 8.0, 0.0);
        assert!((pose.translation_mm - expected).norm() < 1e-12);
    }

    #[test]
    fn a_mounts_covariance_is_read_or_refused() {
        let with = |table: &str, c01: f64| {
            let mut c = [[0.0; 6]; 6];
            (0..6).for_each(|i| c[i][i] = 1e-6);
            (c[0][1], c[1][0]) = (c01, c01);
            AxisChain::parse(&format!("{GOOD}[{table}]\ncovariance = {c:?}\n"))
        };
        let machine = with("sensor", 5e-7).unwrap();
        assert_eq!(machine.sensor_covariance.unwrap()[1][0], 5e-7);
        assert!(with("sensor", 5e-6).is_err());
        assert!(with("workpiece", 0.0).is_err());
        // Three that are each much like the two others, but for one sign: no three numbers are.
        let mut c = [[0.0; 6]; 6];
        (0..6).for_each(|i| c[i][i] = 1e-6);
        for (i, k, sign) in [(0, 1, 1.0), (1, 2, 1.0), (0, 2, -1.0)] {
            (c[i][k], c[k][i]) = (sign * 9e-7, sign * 9e-7);
        }
        let parse =
            |c: [[f64; 6]; 6]| AxisChain::parse(&format!("{GOOD}[sensor]\ncovariance = {c:?}\n"));
        assert!(parse(c).unwrap_err().message.contains("contradict"));
        (c[0][2], c[2][0]) = (9e-7, 9e-7);
        assert!(parse(c).is_ok());
        // All is held, or one error moves all alike.
        assert!(parse([[0.0; 6]; 6]).is_ok() && parse([[1e-6; 6]; 6]).is_ok());
    }

    #[test]
    fn what_no_machine_is_is_named() {
        for (from, to, word) in [
            ("name = \"C\"", "name = \"X\"", "two joints"),
            ("[2.0, 0.0, 0.0]", "[0.0, 0.0, 0.0]", "length above 0"),
            ("sensor = [\"X\"]", "sensor = [\"Q\"]", "no joint"),
            ("sensor = [\"X\"]", "sensor = [\"X\", \"X\"]", "twice"),
            ("sensor = [\"X\"]", "sensor = [\"X\", \"C\"]", "both chains"),
            ("column = \"x\"", "column = \"a\"", "no axis"),
            ("counts_per_mm = -1000.0\n", "", "without scale"),
            (
                "counts_per_mm = -1000.0",
                "counts_per_deg = 1.0",
                "counts_per_mm",
            ),
            (
                "counts_per_mm = -1000.0",
                "counts_per_mm = 0",
                "other than 0",
            ),
            ("point_mm = [10.0, 0.0, 0.0]\n", "", "point_mm"),
            ("kind = \"rotary\"", "kind = \"rotating\"", "unknown"),
            ("column = \"x\"", "column = \"x\"\nvalue = 3.0", "not both"),
            ("origin_counts", "origin_count", "origin_count"),
        ] {
            let text = GOOD.replacen(from, to, 1);
            assert_ne!(text, GOOD, "{from}");
            let error = AxisChain::parse(&text).unwrap_err();
            assert!(error.message.contains(word), "{from} -> {to}: {error}");
        }
    }
}
