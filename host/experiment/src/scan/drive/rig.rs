//! The machine of a scan specification as a scene, its sensor as a line scanner, and its machine
//! file.

use std::fmt::Write as _;

use nalgebra::{Matrix3, Vector3};
use umi_kinematics::{AxisChain, COLUMNS, Drive, JointKind, Pose};
use umi_scan::ScanError;
use umi_scan::plan::program::off_the_spindle;
use umi_scan::plan::spec::ScanSpec;
use umi_scan::surface::Mesh;
use umi_virtual::scanner::LaserTarget;
use umi_virtual::scene::{BeamEnd, LineScannerSpec, Scene};

use super::DriveOptions;

/// Encoder counts of a millimetre and of a degree: a tenth of a micrometre, 0.36 arc seconds.
pub const COUNTS_PER_UNIT: f64 = 10_000.0;

/// Room between the travel and the place where the machine waits.
const SPARE_MM: f64 = 1.0;

/// The middle of the measuring range, from the sensor's origin along the beam: z is 0 there.
fn middle_mm(spec: &ScanSpec) -> f64 {
    let [near, far] = spec.sensor.range_mm;
    f64::midpoint(near, far)
}

/// Where a line scanner is whose frame a specification's sensor has, in that frame.
fn centred(spec: &ScanSpec) -> Pose {
    Pose {
        rotation: Matrix3::identity(),
        translation_mm: Vector3::new(0.0, 0.0, -middle_mm(spec)),
    }
}

/// The words of the rotary axes in the order of the specification: table, head, spindle.
fn words(spec: &ScanSpec) -> Result<Vec<char>, ScanError> {
    let machine = &spec.machine;
    let orient = machine.orient_deg.map(|_| machine.orient_word.clone());
    let axes = machine.table.iter().chain(&machine.head);
    axes.map(|axis| axis.name.clone())
        .chain(orient)
        .map(|name| match name.chars().collect::<Vec<_>>()[..] {
            [word] if "ABCUVW".contains(word) => Ok(word),
            _ => Err(ScanError::refused(
                "machine_spec",
                format_args!(
                    "The virtual control has no word {name:?} for a rotary axis: call it A, B, C, \
                     U, V or W."
                ),
            )),
        })
        .collect()
}

/// The machine of [`scene_text`].
///
/// # Errors
/// `machine_spec` where the virtual machine cannot be this one.
pub fn scene(text: &str) -> Result<Scene, ScanError> {
    Scene::parse(text).map_err(|error| {
        ScanError::refused(
            "machine_spec",
            format_args!("The virtual machine cannot be this one: {error}"),
        )
    })
}

/// The machine as the text of a scene, without bodies: the part is a surface for the laser alone. For a program that lets
/// the control carry the point on the part (`G43.4`, `carries`), G54 is the part's place and H1 the
/// length of spindle and beam.
///
/// # Errors
/// `machine_spec` where the virtual machine or its board cannot have these axes; `nc_mode` where an
/// offset and a length cannot say where part and point are.
pub fn scene_text(
    spec: &ScanSpec,
    options: &DriveOptions,
    carries: bool,
) -> Result<String, ScanError> {
    let machine = &spec.machine;
    let words = words(spec)?;
    let travel = machine.travel_mm;
    let list = |values: [f64; 3]| format!("[{:?}, {:?}, {:?}]", values[0], values[1], values[2]);
    let top = travel[2][1];
    let inside = |[least, most]: [f64; 2]| 0.0_f64.clamp(least, most);
    let mut text = format!(
        "# The machine of a scan path: umi machine run program.nc --scene scene.toml\n[machine]\ntravel_min_mm = {}\ntravel_max_mm = {}\nreference_mm = {}\nstart_mm = {}\n\
         counts_per_mm = {}\n",
        list(travel.map(|[least, _]| least - SPARE_MM)),
        list(travel.map(|[_, most]| most + SPARE_MM)),
        list([inside(travel[0]), inside(travel[1]), top]),
        list([inside(travel[0]), inside(travel[1]), top]),
        list([COUNTS_PER_UNIT; 3]),
    );
    let turning = machine
        .table
        .iter()
        .map(|axis| ("workpiece", axis.direction, axis.point_mm, axis.limits_deg))
        .chain(
            machine
                .head
                .iter()
                .map(|axis| ("spindle", axis.direction, axis.point_mm, axis.limits_deg)),
        )
        .chain(
            machine
                .orient_deg
                .map(|limits| ("spindle", Vector3::z(), Vector3::zeros(), limits)),
        );
    for (word, (carries, axis, point, [least, most])) in words.into_iter().zip(turning) {
        // Writing to a string cannot fail. Words have three decimals: a limit is met by half of one.
        let _ = write!(
            text,
            "[[machine.rotary]]\nword = \"{word}\"\ncarries = \"{carries}\"\naxis = {}\n\
             point_mm = {}\nlimits_deg = [{:?}, {:?}]\nstart_deg = {:?}\n\
             counts_per_deg = {COUNTS_PER_UNIT:?}\n",
            list(axis.into()),
            list(point.into()),
            least - 5e-4,
            most + 5e-4,
            0.0_f64.clamp(least, most),
        );
    }
    let _ = write!(
        text,
        "[control.nc]\ndialect = \"{}\"\n",
        options.dialect.name()
    );
    if carries {
        let (part, tip) = carried(spec)?;
        let _ = write!(
            text,
            "[offsets_mm]\nG54 = {}\n[tools.1]\nlength_mm = {:?}\nradius_mm = 1.0\n",
            list(part.into()),
            -tip.z,
        );
    }
    Ok(text)
}

/// The part's place on the table and the middle ray's point in the spindle's frame, for a control
/// that carries one on the other.
fn carried(spec: &ScanSpec) -> Result<(Vector3<f64>, Vector3<f64>), ScanError> {
    let chain = &spec.machine.chain;
    if (chain.workpiece.rotation - Matrix3::identity()).amax() > 1e-9 {
        return Err(ScanError::refused(
            "nc_mode",
            "The part is turned on its table, which a work offset does not say: stand its axes along \
             those of the machine, or take --nc-mode rotary.",
        ));
    }
    if let Some(tip) = off_the_spindle(spec) {
        return Err(ScanError::refused(
            "nc_mode",
            format_args!(
                "The point on the part lies at X {:.3} Y {:.3} of the spindle, which a tool length does \
                 not say: take --nc-mode rotary.",
                tip.x, tip.y
            ),
        ));
    }
    let tip = chain
        .sensor
        .point(&Vector3::new(0.0, 0.0, -spec.sensor.reference_mm));
    Ok((chain.workpiece.translation_mm, tip))
}

/// The sensor of the specification with its columns and its noise.
#[must_use]
pub fn scanner(spec: &ScanSpec, options: &DriveOptions) -> Option<LineScannerSpec> {
    let sensor = &spec.sensor;
    let [near, far] = sensor.range_mm;
    let width = |distance: f64| sensor.line_mm * distance / sensor.reference_mm;
    let gaps = f64::from(options.columns.max(2) - 1);
    let receiver = sensor.receiver_mm;
    Some(LineScannerSpec {
        clearance_mm: near,
        range_mm: far - near,
        // The outermost columns lie on the field's edge.
        field_mm: [near, far].map(|distance| width(distance) * (1.0 + 1e-9)),
        samples: options.columns,
        pitch_um: [near, far].map(|distance| width(distance) / gaps * 1e3),
        // Along line, feed, beam there; x along the line, y against the feed, z against the beam here.
        camera_mm: Some([receiver.x, -receiver.y, middle_mm(spec) - receiver.z]),
        noise_um: [options.noise_um; 2],
        steepest_deg: sensor.max_incidence_deg,
        ..LineScannerSpec::preset("gocator")?
    })
}

/// The machine file: the specification's chain with the board's encoder inputs, X Y Z first, and
/// the line scanner's own frame.
#[must_use]
pub fn machine_file(spec: &ScanSpec) -> AxisChain {
    let mut chain = spec.machine.chain.clone();
    for (joint, column) in chain.joints.iter_mut().zip(COLUMNS) {
        joint.drive = Drive::Encoder {
            column,
            counts_per_unit: COUNTS_PER_UNIT,
            origin_counts: 0.0,
        };
    }
    chain.sensor = chain.sensor.after(&centred(spec));
    chain
}

/// The same as the text of a machine file.
#[must_use]
pub fn machine_text(chain: &AxisChain) -> String {
    let mut text = String::from("# Of a scan path that was driven on the virtual machine.\n");
    let three = |v: &Vector3<f64>| format!("[{:?}, {:?}, {:?}]", v.x, v.y, v.z);
    for joint in &chain.joints {
        let (kind, scale) = match joint.kind {
            JointKind::Linear => ("linear", "counts_per_mm"),
            JointKind::Rotary => ("rotary", "counts_per_deg"),
        };
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "[[joint]]\nname = {:?}\nkind = \"{kind}\"\ndirection = {}\npoint_mm = {}\n",
            joint.name,
            three(&joint.direction),
            three(&joint.point_mm),
        );
        if let Drive::Encoder {
            column,
            counts_per_unit,
            origin_counts,
        } = joint.drive
        {
            let _ = write!(
                text,
                "column = \"{column}\"\n{scale} = {counts_per_unit:?}\norigin_counts = {origin_counts:?}\n"
            );
        }
    }
    let names = |places: &[usize]| {
        let names = places.iter().filter_map(|place| chain.joints.get(*place));
        let names: Vec<String> = names.map(|joint| format!("{:?}", joint.name)).collect();
        names.join(", ")
    };
    let _ = write!(
        text,
        "[chain]\nsensor = [{}]\nworkpiece = [{}]\n",
        names(&chain.sensor_chain),
        names(&chain.workpiece_chain)
    );
    for (name, pose) in [("sensor", &chain.sensor), ("workpiece", &chain.workpiece)] {
        let rows: Vec<String> = (0..3)
            .map(|row| three(&pose.rotation.row(row).transpose()))
            .collect();
        let _ = write!(
            text,
            "[{name}]\nrotation = [{}]\ntranslation_mm = {}\n",
            rows.join(", "),
            three(&pose.translation_mm)
        );
    }
    text
}

/// The part and what stands beside it, in the part's frame. A mesh may be open: a beam meets what
/// it meets.
#[derive(Debug)]
pub struct Parts<'a> {
    /// The part first.
    pub meshes: Vec<&'a Mesh>,
}

impl LaserTarget for Parts<'_> {
    fn beam(
        &self,
        from_mm: &Vector3<f64>,
        direction: &Vector3<f64>,
        far_mm: f64,
    ) -> Option<BeamEnd> {
        let mut nearest: Option<BeamEnd> = None;
        for mesh in &self.meshes {
            let far = nearest.map_or(far_mm, |end| end.way_mm);
            if let Some(hit) = mesh.first_hit(from_mm, direction, far)
                && let Some(triangle) = mesh.triangles().get(hit.face)
            {
                nearest = Some(BeamEnd {
                    way_mm: hit.at,
                    normal: triangle.normal,
                });
            }
        }
        nearest
    }
}
