//! One run of the experiment.

use nalgebra::Vector3;
use umi_core::correction::dialect::{Turn, form};
use umi_core::registration::RigidTransform;
use umi_core::rewrite;
use umi_core::units::Point;
use umi_protocol::job::{Dialect, Job};
use umi_protocol::verdict::RegistrationReport;
use umi_virtual::cutting::{BallNose, Cutter, Wander, Workpiece};
use umi_virtual::machine::VirtualMachine;
use umi_virtual::nc::{AxisDrives, Control, ControlFamily};
use umi_virtual::scene::Scene;

use super::cases::ExperimentCase;
use super::outcome::{Calibration, ExperimentOutcome, Method, Plane, Setting, Surface};
use super::part::{self, BALL_RADIUS_MM, SEAT_MM, SECTIONS};
use super::path::{self, Passes};
use umi_client::files::job_file;
use umi_client::problem::Problem;
use umi_client::session::DecisionRecord;
use umi_client::session::SessionBuilder;
use umi_client::session::Truth;
use umi_desk::capture::Desk;
use umi_desk::tap::Tap;
use umi_desk::wiring::{Peer, WireEvent, Wiring};

/// The job: that of the example, with the part where it stands here.
const JOB: &str = include_str!("../../../../examples/three-spheres.toml");
/// The machine, the control, the plate.
pub const SCENE: &str = include_str!("shop/scene.toml");
/// The programs in the control's memory before it starts, with the names of their files.
pub const MEMORY: [(&str, &str); 4] = [
    ("ring.nc", include_str!("shop/ring.nc")),
    ("sphere.nc", include_str!("shop/sphere.nc")),
    ("plate.nc", include_str!("shop/plate.nc")),
    ("surface.nc", include_str!("shop/surface.nc")),
];

/// Program numbers.
const RING: u32 = 1041;
const PLATE: u32 = 2000;
const SURFACE: u32 = 2010;
const FINISH: u32 = 2100;
const FINISH_UNCORRECTED: u32 = 2200;

/// Centre of sphere 1 in the reference clamping, mm: where the operator jogs to.
const SPHERE_1_MM: [f64; 3] = [-135.018, -136.624, 135.91];

/// The plate with its spheres, in the scene.
const GROUP: &str = "PLATE";

/// The ring gauge, in the scene; radius of its bore, mm (section 3.5: 71.133 mm); a height
/// inside of it.
const GAUGE: &str = "GAUGE";
const RING_RADIUS_MM: f64 = 71.133 / 2.0;
const IN_RING_MM: f64 = 92.0;

/// Heights that the operator knows, mm: above all spheres, above the plate's surface.
const ABOVE_SPHERES_MM: f64 = 160.0;
const ABOVE_PLATE_MM: f64 = SEAT_MM + 5.0;

/// Standard deviation of a position while cutting, mm: half of 1.0 µm (2σ), table 5.5.
const CUTTING_SIGMA_MM: f64 = 0.0005;

/// How far an experiment is.
#[derive(Clone, Debug)]
pub enum ExperimentProgress<'a> {
    /// A step of a clamping begins.
    Step {
        /// The clamping.
        case: usize,
        /// What begins, in a word or two.
        what: &'static str,
    },
    /// The board decided.
    Decision(&'a DecisionRecord),
    /// A clamping was judged; its place in the session's setups.
    Judged(&'a umi_client::session::Session, usize),
}

/// Steps of a run that [`ExperimentProgress::Step`] announces.
#[must_use]
pub fn steps(cases: &[ExperimentCase]) -> usize {
    cases.len() * STEPS_OF_A_CASE
}

const STEPS_OF_A_CASE: usize = 4;

/// The job for this part: the example's, its part standing on the plate.
///
/// # Errors
/// The example is not a job.
pub fn job() -> Result<Job, Problem> {
    let mut job =
        job_file::parse(JOB).map_err(|fault| Problem::trouble("experiment", fault.message))?;
    if let Some(correction) = &mut job.correction {
        let y = part::border_y_mm();
        let nominal = part::NOMINAL;
        let edge = nominal.height_mm(nominal.axis_y_mm + y).unwrap_or(SEAT_MM);
        let [left, right] = part::PASS_X_MM;
        correction.part_min_mm = [left, nominal.axis_y_mm - y, edge];
        correction.part_max_mm = [
            right,
            nominal.axis_y_mm + y,
            nominal.axis_z_mm + nominal.radius_mm,
        ];
    }
    // The routine prints the top from another touch than the one that set the height of
    // the side hits. Both are single hits at 100 mm/min: the control's 0 to 4 ms alone
    // let them differ by 0.0067 mm.
    job.limits.lone_hit_mm = Some(LONE_HIT_MM);
    job.limits.tilt_deg = TILT_DEG;
    Ok(job)
}

/// The limit for it, mm.
const LONE_HIT_MM: f64 = 0.012;

/// The limit of the tilt, degrees: the thesis' registrations print up to 0.0002 rad
/// (table 4.2), 0.0115 degrees. What it leaves at the part has a limit of its own.
const TILT_DEG: f64 = 0.015;

/// The shop: a machine with its control, a board on its wires, a workpiece. The probing
/// programs are in Fanuc's language; a remedy in another one is finished by a second control
/// on the same axes.
struct Shop {
    control: Control,
    finisher: Option<Control>,
    cutter: Cutter<VirtualMachine<Tap>>,
    /// The workpiece that is cut without corrections, while it is not in the machine.
    spare: Workpiece,
    /// Crashes with the corrected and with the other workpiece.
    crashes: [usize; 2],
}

impl Shop {
    fn run(&mut self, program: u32) -> Result<(), Problem> {
        self.control.select(program).map_err(alarm)?;
        self.control.run(&mut self.cutter).map_err(alarm)?;
        Ok(())
    }

    fn load(&mut self, text: &str) -> Result<(), Problem> {
        self.control.load(text).map_err(alarm)?;
        Ok(())
    }

    /// The control that finishes.
    fn finishing(&mut self) -> (&mut Control, &mut Cutter<VirtualMachine<Tap>>) {
        let control = self.finisher.as_mut().unwrap_or(&mut self.control);
        (control, &mut self.cutter)
    }

    fn set(&mut self, variable: u32, value: f64) -> Result<(), Problem> {
        self.control
            .set_variable(variable, Some(value))
            .map_err(alarm)
    }

    fn tap(&mut self) -> &mut Tap {
        self.cutter.axes_mut().wires_mut()
    }

    /// Exchanges the workpieces; both stand on the plate alike.
    fn exchange(&mut self) {
        std::mem::swap(self.cutter.workpiece_mut(), &mut self.spare);
    }

    /// Cuts and counts the crashes.
    fn cut(&mut self, text: &str, workpiece: usize) -> Result<(), Problem> {
        let before = self.cutter.crashes().len();
        let (control, axes) = self.finishing();
        let language = control.settings().dialect;
        if language == ControlFamily::Grbl {
            // It has no M6: by hand.
            AxisDrives::change_tool(axes, path::TOOL)
                .map_err(|trip| Problem::refused("trip", trip.message))?;
        }
        let loaded = control
            .load(&path::in_language(text, language))
            .map_err(alarm)?;
        control
            .select(loaded.first().copied().unwrap_or_default())
            .map_err(alarm)?;
        control.run(axes).map_err(alarm)?;
        self.crashes[workpiece] += self.cutter.crashes().len() - before;
        Ok(())
    }
}

fn alarm(alarm: umi_virtual::nc::Alarm) -> Problem {
    Problem::refused("alarm", alarm)
}

/// The control that understands a remedy, where it is not the one that probes.
fn finisher(remedy: Method) -> Option<Control> {
    let language = match remedy {
        Method::Program(Dialect::Haas) => ControlFamily::Haas,
        Method::Program(Dialect::LinuxCnc) => ControlFamily::LinuxCnc,
        Method::Program(Dialect::Grbl) => ControlFamily::Grbl,
        // The others are in the words of the control that probes, or of none that is here:
        // see `Remedy::ALL`.
        Method::Program(_) | Method::Rewritten => return None,
    };
    Some(Control::new(umi_virtual::nc::ControlSettings::of(language)))
}

/// Runs the experiment.
///
/// # Errors
/// Whatever stops it: an alarm of the control, trouble with the board, a program that
/// the control did not get. A verdict NG is none: it stays without correction, its
/// section is not cut, and the session shows it.
pub fn run<E: From<Problem>>(
    setting: &Setting,
    cases: &[ExperimentCase],
    mut progress: impl FnMut(ExperimentProgress<'_>) -> Result<(), E>,
) -> Result<(ExperimentOutcome, Desk), E> {
    let trouble = |error: &dyn std::fmt::Display| Problem::trouble("experiment", error);
    let passes = Passes::new(setting.stepover_mm).map_err(|error| trouble(&error))?;
    let blank = part::blank(setting.pitch_mm).map_err(|error| trouble(&error))?;
    let mut job = job()?;
    if let (Some(correction), Method::Program(dialect)) = (&mut job.correction, setting.remedy) {
        correction.dialect = dialect;
    }
    let bench = Desk::new(&job)?;
    let mut gather = SessionBuilder::new(
        "The thesis\u{2019} experiment: five clampings, one surface",
        ABOUT,
        &job,
        Some(&bench.identity().clone()),
    );
    gather.session.path_points_mm = passes.landmarks_mm();

    let sigma_mm = if setting.ideal { 0.0 } else { CUTTING_SIGMA_MM };
    let mut scene = Scene::parse(SCENE).map_err(|error| trouble(&error))?;
    if setting.ideal {
        idealise(&mut scene);
    }
    let sources = sources(&scene, sigma_mm);
    let tip_radius_mm = scene.probe.tip_radius_mm;
    let tap = Tap::new(Wiring::new(Peer::Board(Box::new(bench))));
    let machine = VirtualMachine::new(scene, setting.seed, tap);
    let tool = BallNose {
        length_mm: 0.0,
        radius_mm: BALL_RADIUS_MM,
    };
    let mut shop = Shop {
        control: Control::new(umi_virtual::nc::ControlSettings::default()),
        finisher: finisher(setting.remedy),
        cutter: Cutter::new(machine, blank.clone())
            .with_tool(path::TOOL, tool)
            .with_wander(Wander::new(sigma_mm, setting.seed)),
        spare: blank,
        crashes: [0, 0],
    };
    for (_, text) in MEMORY {
        shop.load(text)?;
    }

    let calibration = calibrate(&mut shop, tip_radius_mm)?;
    let mut planes = Vec::new();
    let mut corrections = Vec::new();
    let mut programs = Vec::new();
    for (number, case) in cases.iter().enumerate() {
        let mut step = |what| progress(ExperimentProgress::Step { case: number, what });
        step("probing")?;
        clamp(&mut shop, case)?;
        shop.run(PLATE)?;
        let mut judged = None;
        for event in shop.tap().board.take()? {
            if let WireEvent::Decision(decision) = event {
                progress(ExperimentProgress::Decision(&decision))?;
                judged = judged.or(gather.take(*decision));
            }
        }
        let Some(place) = judged else {
            return Err(Problem::refused(
                "experiment",
                format_args!("{}: the board gave no verdict", case.title),
            )
            .into());
        };
        let setup = &mut gather.session.setups[place];
        setup.title.clone_from(&case.title);
        setup.about.clone_from(&case.about);
        setup.truth = Some(truth(case));
        let correction = setup
            .verdict
            .correction
            .as_ref()
            .map(|c| c.text.to_string());
        let ok = setup.verdict.ok;
        let registration = setup.verdict.registration.clone();
        progress(ExperimentProgress::Judged(&gather.session, place))?;

        let mut step = |what| progress(ExperimentProgress::Step { case: number, what });
        step("reading the correction")?;
        if let Some(expected) = &correction {
            let program = shop.tap().board.read_program()?;
            let Some(program) = program.filter(|program| program == expected) else {
                return Err(Problem::refused(
                    "experiment",
                    format_args!(
                        "{}: the control got another program than the verdict holds",
                        case.title
                    ),
                )
                .into());
            };
            // GRBL and LinuxCNC get it in one file with what it corrects.
            if !matches!(
                setting.remedy,
                Method::Program(Dialect::LinuxCnc | Dialect::Grbl)
            ) {
                shop.finishing().0.load(&program).map_err(alarm)?;
            }
        }
        shop.tap().listen();
        shop.run(SURFACE)?;
        let points = shop.tap().heard()?;
        planes.push(Plane::fit(&points).map_err(|error| trouble(&error))?);

        step("cutting")?;
        let section = number.min(SECTIONS - 1);
        let number = u32::try_from(section).unwrap_or_default();
        let program = match (&correction, setting.remedy, registration) {
            // The reference clamping is cut as it stands.
            (None, ..) => ok.then(|| passes.program(FINISH + number, section, "G54")),
            (Some(text), Method::Program(Dialect::LinuxCnc), _) => {
                let call = "G54\no<umi_correction> call";
                let main = passes.program(FINISH + number, section, call);
                let subroutine = text.strip_suffix("M2\n").unwrap_or(text);
                Some(format!("{subroutine}{main}"))
            }
            (Some(text), Method::Program(Dialect::Grbl), _) => {
                let sent = format!("G54\n{}", text.trim_end());
                Some(passes.program(FINISH + number, section, &sent))
            }
            (Some(_), Method::Program(dialect), _) => {
                // Where Z leans, X and Y move it: at the top of its travel there is no room.
                let leans = matches!(form(dialect).turn, Turn::Axis | Turn::Angles);
                let down = if leans { BELOW_THE_TOP } else { "" };
                let call = format!("{down}M98 P9010 (CORRECTION)");
                let program = passes.program(FINISH + number, section, &call);
                // A setting error is not ended by G69.
                let ends = form(dialect).in_set;
                let end = if ends { " G69\nG54.4 P0\n" } else { " G69\n" };
                Some(program.replacen(" G69\n", end, 1))
            }
            (Some(_), Method::Rewritten, Some(registration)) => {
                let call = format!("{BELOW_THE_TOP}G54");
                let nominal = passes.program(FINISH + number, section, &call);
                Some(rewritten(&nominal, &registration)?)
            }
            (Some(_), Method::Rewritten, None) => None,
        };
        if let Some(program) = &program {
            shop.cut(program, 0)?;
        }
        programs.push(program);
        step("cutting uncorrected")?;
        shop.exchange();
        let program = passes.program(FINISH_UNCORRECTED + number, section, "G54");
        let cut = shop.cut(&program, 1);
        shop.exchange();
        cut?;
        corrections.push(correction);
    }

    let measure = |workpiece: &Workpiece, crashes| {
        Surface::measure(workpiece, &passes, crashes).ok_or_else(|| {
            Problem::trouble(
                "experiment",
                "the grid is too coarse: a section has no node",
            )
        })
    };
    let corrected = measure(shop.cutter.workpiece(), shop.crashes[0])?;
    let uncorrected = measure(&shop.spare, shop.crashes[1])?;
    let machine_s = AxisDrives::seconds(&shop.cutter);
    let printed_bytes = shop.tap().printed_bytes;
    let (machine, _, _) = shop.cutter.into_parts();
    let Some(bench) = machine.into_wires().board.into_bench() else {
        return Err(Problem::trouble("experiment", "the board is gone").into());
    };
    let outcome = ExperimentOutcome {
        setting: *setting,
        sources,
        calibration,
        compensation_mm: COMPENSATION_MM,
        position_error_mm: cases
            .iter()
            .map(|case| position_error_mm(case, &passes))
            .collect(),
        passes,
        session: gather.session,
        corrected,
        uncorrected,
        planes,
        printed_bytes,
        corrections,
        programs,
        machine_s,
    };
    Ok((outcome, bench))
}

/// A block that leaves Z room to lean.
const BELOW_THE_TOP: &str = "G53 G0 Z390.\n";

/// The finishing program where the part stands.
fn rewritten(nominal: &str, registration: &RegistrationReport) -> Result<String, Problem> {
    let [a, b, c] = registration.rotation;
    let mut settings = rewrite::RewriteSettings::new(RigidTransform {
        rotation: nalgebra::Matrix3::from_rows(&[a.into(), b.into(), c.into()]),
        translation_mm: registration.translation_mm.into(),
    });
    // Behind G53 the program goes on below the top of Z.
    settings.loose_rapids = true;
    let mut text = Vec::new();
    let mut sink = |bytes: &[u8]| text.extend_from_slice(bytes);
    let refused = |refusal| Problem::refused("cannot_rewrite", refusal);
    let mut rewriter =
        rewrite::Rewriter::new(&settings).map_err(|bad| Problem::trouble("experiment", bad))?;
    rewriter
        .push(nominal.as_bytes(), &mut sink)
        .map_err(refused)?;
    rewriter.finish(&mut sink).map_err(refused)?;
    String::from_utf8(text).map_err(|error| Problem::trouble("experiment", error))
}

const ABOUT: &str = "A plate with three spheres and a workpiece with a cylindrical surface, clamped five times \
    as in A. Sawula\u{2019}s thesis (2013, chapters 4 and 5). In each clamping a virtual machine probes the \
    spheres by the thesis\u{2019} routine, a virtual openumi board reads the control\u{2019}s serial line, registers \
    the plate and gives the control a correction, and a fifth of the surface is finished with it. Verdicts, \
    figures and corrections came over the board\u{2019}s link.";

/// The probe in the ring gauge, before the plate is on the table; then the gauge goes.
fn calibrate(shop: &mut Shop, tip_radius_mm: f64) -> Result<Calibration, Problem> {
    let trouble = |error: &dyn std::fmt::Display| Problem::trouble("experiment", error);
    let away = |metres: f64| RigidTransform {
        translation_mm: Vector3::new(0.0, 0.0, -metres * 1e3),
        ..RigidTransform::identity()
    };
    let mut place = |group, pose| {
        let placed = shop.cutter.axes_mut().scene_mut().place(group, pose);
        placed
            .then_some(())
            .ok_or_else(|| Problem::trouble("experiment", "the scene lacks a group"))
    };
    place(GROUP, away(10.0))?;
    place(GAUGE, away(0.0))?;
    shop.set(103, ABOVE_SPHERES_MM)?;
    shop.set(104, 0.0)?;
    shop.set(105, 0.0)?;
    shop.set(107, IN_RING_MM)?;
    shop.tap().listen();
    shop.run(RING)?;
    let points = shop.tap().heard()?;
    let calibration = Calibration::fit(&points, RING_RADIUS_MM - tip_radius_mm)
        .map_err(|error| trouble(&error))?;
    if !shop.cutter.axes_mut().scene_mut().place(GAUGE, away(10.0)) {
        return Err(Problem::trouble("experiment", "the scene lacks a group"));
    }
    Ok(calibration)
}

/// The plate and both workpieces are clamped as the case says; the operator jogs to
/// whole millimetres over sphere 1.
fn clamp(shop: &mut Shop, case: &ExperimentCase) -> Result<(), Problem> {
    if !shop.cutter.axes_mut().scene_mut().place(GROUP, case.pose) {
        return Err(Problem::trouble("experiment", "the scene has no plate"));
    }
    shop.cutter.workpiece_mut().clamp(case.pose);
    shop.spare.clamp(case.pose);
    let sphere = case.pose.apply(Point::from_array_mm(SPHERE_1_MM)).mm;
    let middle = case.pose.apply(Point::from_mm(0.0, 0.0, 0.0)).mm;
    shop.set(101, sphere.x.round())?;
    shop.set(102, sphere.y.round())?;
    shop.set(103, ABOVE_SPHERES_MM)?;
    shop.set(104, middle.x.round())?;
    shop.set(105, middle.y.round())?;
    shop.set(106, ABOVE_PLATE_MM)
}

fn truth(case: &ExperimentCase) -> Truth {
    let r = &case.pose.rotation;
    Truth {
        rotation: std::array::from_fn(|row| std::array::from_fn(|column| r[(row, column)])),
        translation_mm: case.pose.translation_mm.into(),
    }
}

/// How far a point of the path is from where it should be on the part, if nothing is
/// corrected: the largest, mm.
fn position_error_mm(case: &ExperimentCase, passes: &Passes) -> f64 {
    passes
        .landmarks_mm()
        .into_iter()
        .map(|p| {
            let p = Vector3::from(p);
            (case.pose.apply(Point { mm: p }).mm - p).norm()
        })
        .fold(0.0, f64::max)
}

/// What the routine adds for the probe's pretravel (appendix D), mm.
const COMPENSATION_MM: f64 = 0.062;

/// Switches all error sources off: what is compensated is what the probe has.
fn idealise(scene: &mut Scene) {
    let (machine, probe) = (&mut scene.machine, &mut scene.probe);
    machine.position_noise_um = 0.0;
    scene.control.skip_delay_ms = [0.0, 0.0];
    probe.pretravel_mm = COMPENSATION_MM;
    probe.lobing_mm = 0.0;
    probe.ovality_mm = 0.0;
    probe.axial_pretravel_mm = 0.0;
    probe.repeatability_um = 0.0;
}

/// The error sources in words.
fn sources(scene: &Scene, cutting_sigma_mm: f64) -> Vec<(String, String)> {
    let (machine, probe) = (&scene.machine, &scene.probe);
    let [shortest, longest] = scene.control.skip_delay_ms;
    [
        (
            "Position of the machine while probing",
            format!("{:.1} \u{b5}m (2\u{3c3})", machine.position_noise_um),
        ),
        (
            "Repeatability of the probe",
            format!("{:.1} \u{b5}m (2\u{3c3})", probe.repeatability_um),
        ),
        (
            "Pretravel",
            format!(
                "{:.1} \u{b5}m on average, compensated with {:.1} \u{b5}m; \u{b1}{:.1} \u{b5}m with the direction \
                 (three lobes), \u{b1}{:.1} \u{b5}m between X and Y; {:.1} \u{b5}m along Z, not compensated",
                probe.pretravel_mm * 1e3,
                COMPENSATION_MM * 1e3,
                probe.lobing_mm * 1e3,
                probe.ovality_mm * 1e3,
                probe.axial_pretravel_mm * 1e3
            ),
        ),
        (
            "Delay of the control at a skip",
            format!(
                "{shortest:.0} to {longest:.0} ms, evenly: up to {:.1} \u{b5}m along Z (100 mm/min), up to {:.1} \u{b5}m                  in X and Y (20 mm/min)",
                longest * 100.0 / 60.0,
                longest * 20.0 / 60.0
            ),
        ),
        (
            "Position of the machine while cutting",
            format!("{:.1} \u{b5}m (2\u{3c3})", cutting_sigma_mm * 2e3),
        ),
        (
            "Numbers of the control",
            "0.001 mm and 0.001 degree, in programs, corrections and stored positions".into(),
        ),
    ]
    .map(|(name, amount)| (name.to_owned(), amount))
    .into()
}
