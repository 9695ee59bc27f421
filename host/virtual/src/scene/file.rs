//! The scene as a file.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use umi_core::registration::RigidTransform;
use umi_kinematics::{AxisChain, Pose};

use super::{
    AreaScannerSpec, Body, Group, LineScannerSpec, PointSensorSpec, RotarySpec, Scene, SceneError,
    SceneShape, joined, pose, range, rotary,
};
use crate::nc::{ControlSettings, OffsetSystem};

/// The machine tool and its errors. All defaults are those of an ideal machine.
///
/// The encoders tell the control where an axis is; the truth differs from that by
/// `scale_error_ppm`, `homing_error_mm` and the drift, which neither the control nor
/// the board can see.
#[derive(Clone, Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MachineSpec {
    /// Least coordinates that the axes reach.
    pub travel_min_mm: [f64; 3],
    /// Largest coordinates that the axes reach.
    pub travel_max_mm: [f64; 3],
    /// Reference point of G28.
    pub reference_mm: [f64; 3],
    /// Where the axes stand at the start.
    pub start_mm: [f64; 3],
    /// Fastest motion along a path.
    pub rapid_mm_per_min: f64,
    /// Acceleration along a path.
    pub acceleration_mm_per_s2: f64,
    /// Gain of the position loop of all axes (Kv): they follow with a lag of speed over
    /// gain. 0: without lag.
    pub position_gain_per_s: f64,
    /// Encoder counts per millimetre, negative where they count down.
    pub counts_per_mm: [f64; 3],
    /// Encoder counts where the machine coordinate is zero: where the board's counters
    /// began.
    pub origin_counts: [i64; 3],
    /// Counts between index marks; an index stands at every multiple of it.
    pub index_counts: i64,
    /// Rotary axes, at the board's encoder inputs after Z.
    pub rotary: Vec<RotarySpec>,
    /// The machine's datum is off by this much.
    pub homing_error_mm: [f64; 3],
    /// Truth over encoder less one, in millionths.
    pub scale_error_ppm: [f64; 3],
    /// Repeatability of a position (2 sigma).
    pub position_noise_um: f64,
    /// The truth moves away by this much as the machine warms up,
    pub drift_mm: [f64; 3],
    /// with this time constant.
    pub drift_time_s: f64,
}

impl Default for MachineSpec {
    fn default() -> Self {
        Self {
            travel_min_mm: [-500.0, -500.0, -500.0],
            travel_max_mm: [500.0, 500.0, 500.0],
            reference_mm: [0.0, 0.0, 500.0],
            start_mm: [0.0, 0.0, 500.0],
            rapid_mm_per_min: 20_000.0,
            acceleration_mm_per_s2: 2_000.0,
            position_gain_per_s: 0.0,
            counts_per_mm: [10_000.0; 3],
            origin_counts: [0; 3],
            index_counts: 0,
            rotary: Vec::new(),
            homing_error_mm: [0.0; 3],
            scale_error_ppm: [0.0; 3],
            position_noise_um: 0.0,
            drift_mm: [0.0; 3],
            drift_time_s: 3600.0,
        }
    }
}

/// The control.
#[derive(Clone, Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ControlSpec {
    /// Its language and parameters.
    pub nc: ControlSettings,
    /// Shortest and longest time between the skip signal and the moment at which it
    /// stores the position: 0 to 4 ms in A. Sawula's thesis (2013, section 3.5.1).
    pub skip_delay_ms: [f64; 2],
    /// It looks at the skip signal only at multiples of this, and the delay counts from
    /// there; their phase comes with the seed. 0: at any time.
    pub skip_poll_ms: f64,
    /// Which position it stores.
    pub skip_stores: Stores,
    /// Speed of its serial line.
    pub baud: u32,
    /// Bits of a character on the line, start and stop bits counted.
    pub bits: u32,
}

impl Default for ControlSpec {
    fn default() -> Self {
        Self {
            nc: ControlSettings::default(),
            skip_delay_ms: [0.0; 2],
            skip_poll_ms: 0.0,
            skip_stores: Stores::Actual,
            baud: 9600,
            bits: 11,
        }
    }
}

/// Which position a control stores at a skip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stores {
    /// Where the axes are when it looks: servo lag does not enter (Fanuc with 6201#1 SEB,
    /// Mitsubishi).
    #[default]
    Actual,
    /// Where it has sent them: feed over gain too far.
    Sent,
}

/// The touch probe.
///
/// It triggers when the stylus is bent by the pretravel. In the XY plane that is
/// `pretravel_mm + lobing_mm cos 3 (θ - lobing_phase_deg) + ovality_mm cos 2θ`, θ the
/// direction in which the tip is pushed (three supports: thesis, figure 3.5), along Z it
/// is `axial_pretravel_mm`; between them goes the square of the sine of the elevation.
/// Three lobes cancel in a pair of opposite hits; where such pairs differ between X and
/// Y, as by 0.013 mm in the thesis' table 5.2, that is the ovality.
#[derive(Clone, Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ProbeSpec {
    /// The tool number that it answers to; it is in the spindle at the start.
    pub tool: u32,
    /// Radius of the tip.
    pub tip_radius_mm: f64,
    /// Gauge line to tip centre. 0: the axes' position is that of the tip centre.
    pub length_mm: f64,
    /// Radius of the stem above the tip, which must touch nothing; 0: none.
    pub stem_radius_mm: f64,
    /// How far the stem reaches above the tip's centre.
    pub stem_length_mm: f64,
    /// Mean in the XY plane.
    pub pretravel_mm: f64,
    /// Amplitude of the three lobes.
    pub lobing_mm: f64,
    /// Direction of a lobe.
    pub lobing_phase_deg: f64,
    /// How much more than the mean it is along X, and less along Y.
    pub ovality_mm: f64,
    /// Along Z.
    pub axial_pretravel_mm: f64,
    /// Repeatability of the trigger (2 sigma).
    pub repeatability_um: f64,
    /// Time between trigger and skip line.
    pub filter_us: f64,
    /// The stylus breaks beyond this.
    pub overtravel_mm: f64,
}

impl Default for ProbeSpec {
    fn default() -> Self {
        Self {
            tool: 99,
            tip_radius_mm: 2.5,
            length_mm: 0.0,
            stem_radius_mm: 0.0,
            stem_length_mm: 50.0,
            pretravel_mm: 0.0,
            lobing_mm: 0.0,
            lobing_phase_deg: 0.0,
            ovality_mm: 0.0,
            axial_pretravel_mm: 0.0,
            repeatability_um: 0.0,
            filter_us: 0.0,
            overtravel_mm: 5.0,
        }
    }
}

/// A tool in the magazine.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToolSpec {
    /// Gauge line to tip.
    pub length_mm: f64,
    /// Radius of its ball nose.
    pub radius_mm: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    machine: MachineSpec,
    #[serde(default)]
    control: ControlSpec,
    #[serde(default)]
    probe: ProbeSpec,
    point_sensor: Option<PointSensorSpec>,
    scanner: Option<AreaScannerSpec>,
    line_scanner: Option<LineScannerSpec>,
    #[serde(default)]
    offsets_mm: BTreeMap<String, [f64; 3]>,
    #[serde(default)]
    setting_errors: BTreeMap<String, SettingError>,
    #[serde(default)]
    tools: BTreeMap<String, ToolSpec>,
    #[serde(default, rename = "group")]
    groups: Vec<GroupEntry>,
    #[serde(default, rename = "body")]
    bodies: Vec<BodyEntry>,
}

/// A workpiece setting error, in the axes of the work coordinate system.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SettingError {
    #[serde(default)]
    translation_mm: [f64; 3],
    /// About X, then Y, then Z.
    #[serde(default)]
    rotation_deg: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GroupEntry {
    name: String,
    #[serde(default)]
    translation_mm: [f64; 3],
    /// About X, then Y, then Z of the machine.
    #[serde(default)]
    rotation_deg: [f64; 3],
    #[serde(default)]
    pivot_mm: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BodyEntry {
    name: String,
    shape: SceneShape,
    group: Option<String>,
    #[serde(default)]
    position_mm: [f64; 3],
    /// About X, then Y, then Z of the group.
    #[serde(default)]
    rotation_deg: [f64; 3],
    #[serde(default)]
    cuttable: bool,
    /// Raw material above an arc that may be cut.
    #[serde(default)]
    stock_mm: f64,
}

pub(super) fn parse(text: &str, folder: &Path) -> Result<Scene, SceneError> {
    let refuse = |message: String| Err(SceneError { message });
    let unread = |error: toml::de::Error| SceneError {
        message: error.to_string().trim_end().to_owned(),
    };
    range::check(&toml::from_str(text).map_err(unread)?)?;
    let mut file: File = toml::from_str(text).map_err(unread)?;
    file.machine.check()?;
    file.control.nc.rotary_words = file.machine.rotary_words();
    let [shortest, longest] = file.control.skip_delay_ms;
    if shortest > longest {
        return refuse(
            "`control.skip_delay_ms` needs the shortest delay first, then the longest".into(),
        );
    }
    if file.probe.stem_radius_mm >= file.probe.tip_radius_mm {
        return refuse(
            "`probe.stem_radius_mm` must be less than `probe.tip_radius_mm`; 0 is no stem".into(),
        );
    }
    if let Some(sensor) = &file.point_sensor {
        sensor.check(file.probe.tool)?;
    }
    if let Some(scanner) = &file.scanner {
        scanner.check()?;
    }
    if let Some(scanner) = &file.line_scanner {
        scanner.check()?;
    }
    let mut groups: Vec<Group> = Vec::new();
    for entry in file.groups {
        if groups.iter().any(|group| group.name == entry.name) {
            return refuse(format!("group {}: there are two of this name", entry.name));
        }
        groups.push(Group {
            pose: pose(entry.translation_mm, entry.rotation_deg, entry.pivot_mm),
            name: entry.name,
        });
    }
    let mut bodies: Vec<Body> = Vec::new();
    for mut entry in file.bodies {
        let name = &entry.name;
        if bodies.iter().any(|body| body.name == *name) {
            return refuse(format!("body {name}: there are two of this name"));
        }
        if let Some(fault) = entry.shape.fault() {
            return refuse(format!("body {name}: {fault}"));
        }
        if let SceneShape::Mesh(mesh) = &mut entry.shape {
            mesh.load(folder).map_err(|message| SceneError {
                message: format!("body {name}: {message}"),
            })?;
        }
        if !(entry.stock_mm >= 0.0 && entry.stock_mm.is_finite()) {
            return refuse(format!("body {name}: `stock_mm` is 0 or more"));
        }
        let group = match &entry.group {
            None => None,
            Some(wanted) => match groups.iter().position(|group| group.name == *wanted) {
                Some(group) => Some(group),
                None => {
                    return refuse(format!(
                        "body {name}: there is no group {wanted}; add a [[group]] of this name"
                    ));
                }
            },
        };
        let own = pose(entry.position_mm, entry.rotation_deg, [0.0; 3]);
        let outer = group
            .and_then(|group| groups.get(group))
            .map_or_else(RigidTransform::identity, |group| group.pose);
        bodies.push(Body {
            placed: joined(&outer, &own),
            name: entry.name,
            shape: entry.shape,
            cuttable: entry.cuttable,
            stock_mm: entry.stock_mm,
            pose: own,
            group,
        });
    }
    let mut tools: Vec<(u32, ToolSpec)> = Vec::new();
    for (number, tool) in file.tools {
        match number.parse() {
            Ok(number) if tools.iter().any(|(has, _)| *has == number) => {
                return refuse(format!("tools.{number}: there are two of this number"));
            }
            Ok(number)
                if file
                    .point_sensor
                    .as_ref()
                    .is_some_and(|sensor| sensor.tool == number) =>
            {
                return refuse(format!("tools.{number}: this is the point sensor's number"));
            }
            Ok(number) if number != file.probe.tool => tools.push((number, tool)),
            Ok(_) => return refuse(format!("tools.{number}: this is the probe's number")),
            Err(_) => return refuse(format!("tools.{number}: a tool's name is its number")),
        }
    }
    let mut offsets_mm = Vec::new();
    for (name, origin_mm) in file.offsets_mm {
        match OffsetSystem::named(&name) {
            Some(offset) => offsets_mm.push((offset, origin_mm)),
            None => {
                return refuse(format!(
                    "offsets_mm.{name}: offsets are G54 to G59, \"G54.1P1\" to \"G54.1P300\", EXT"
                ));
            }
        }
    }
    let mut setting_errors = Vec::new();
    for (name, error) in file.setting_errors {
        let set = name
            .strip_prefix('P')
            .and_then(|number| number.parse().ok());
        let Some(set) = set.filter(|set| (1..=7).contains(set)) else {
            return refuse(format!(
                "setting_errors.{name}: setting errors (G54.4) are P1 to P7"
            ));
        };
        let [x, y, z] = error.translation_mm;
        let [a, b, c] = error.rotation_deg;
        let values = [x, y, z, a, b, c];
        if !values.iter().all(|value| value.abs() <= 1e6) {
            return refuse(format!(
                "setting_errors.{name}: give lengths and angles up to a million"
            ));
        }
        setting_errors.push((set, values));
    }
    Ok(Scene {
        machine: file.machine,
        control: file.control,
        probe: file.probe,
        point_sensor: file.point_sensor,
        scanner: file.scanner,
        line_scanner: file.line_scanner,
        offsets_mm,
        setting_errors,
        tools,
        bodies,
        groups,
    })
}

impl MachineSpec {
    /// The words of its rotary axes, as its control knows them.
    #[must_use]
    pub fn rotary_words(&self) -> String {
        self.rotary.iter().map(|axis| axis.word).collect()
    }

    /// The machine as a chain from the workpiece to a sensor that is mounted like this with all
    /// axes at 0. Its joints are X, Y, Z and the rotary axes in the order of the scene.
    #[must_use]
    pub fn chain(&self, mount: Pose) -> AxisChain {
        rotary::chain(&self.rotary, mount)
    }

    /// What no single number tells: their order, and what stands apart.
    fn check(&self) -> Result<(), SceneError> {
        rotary::check(&self.rotary)?;
        let refuse = |message: String| Err(SceneError { message });
        let limits = || self.travel_min_mm.into_iter().zip(self.travel_max_mm);
        if !limits().all(|(least, most)| least < most) {
            return refuse(
                "`machine.travel_max_mm` must be above `machine.travel_min_mm` in each axis".into(),
            );
        }
        for (name, at) in [
            ("start_mm", self.start_mm),
            ("reference_mm", self.reference_mm),
        ] {
            let within = |((least, most), mm)| (least..=most).contains(&mm);
            if !limits().zip(at).all(within) {
                return refuse(format!(
                    "`machine.{name}` is {at:?}; give a place from `machine.travel_min_mm` {:?} to \
                     `machine.travel_max_mm` {:?}",
                    self.travel_min_mm, self.travel_max_mm
                ));
            }
        }
        if self.position_gain_per_s > 0.0 && self.position_gain_per_s < 1.0 {
            return refuse(
                "`machine.position_gain_per_s` must be 1 or more, so that a motion ends; 0 is no lag"
                    .into(),
            );
        }
        if self.counts_per_mm.iter().any(|counts| counts.abs() < 1.0) {
            return refuse(
                "`machine.counts_per_mm` needs 1 or more for each axis, negative where they count \
                 down"
                    .into(),
            );
        }
        Ok(())
    }
}

impl SceneShape {
    /// What makes it impossible.
    fn fault(&self) -> Option<&'static str> {
        let positive = |values: &[f64]| values.iter().all(|v| *v > 0.0 && v.is_finite());
        let sound = match *self {
            // What a mesh may be is known once its file is read.
            Self::HalfSpace | Self::Mesh(_) => true,
            Self::Sphere { radius_mm } => positive(&[radius_mm]),
            Self::Block { size_mm } => positive(&size_mm),
            Self::Cylinder {
                radius_mm,
                height_mm,
            } => positive(&[radius_mm, height_mm]),
            Self::Cone {
                half_angle_deg,
                height_mm,
            } => positive(&[half_angle_deg, 90.0 - half_angle_deg, height_mm]),
            Self::Ring {
                radius_mm,
                outer_radius_mm,
                height_mm,
            } => positive(&[radius_mm, outer_radius_mm - radius_mm, height_mm]),
            Self::Arc {
                radius_mm,
                length_mm,
                width_mm,
                height_mm,
            } => {
                // The edges of the crown must lie above the bottom.
                let half = width_mm / 2.0;
                let sagitta = radius_mm - libm::sqrt((radius_mm - half) * (radius_mm + half));
                positive(&[radius_mm, length_mm, width_mm, height_mm - sagitta])
            }
        };
        (!sound).then_some(
            "its dimensions must be above 0, `outer_radius_mm` larger than `radius_mm`, a cone's half \
             angle below 90, an arc no wider than its cylinder and higher than its sagitta",
        )
    }
}
