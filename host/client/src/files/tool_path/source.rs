//! Where a transform comes from: a file of its own, or a verdict.

use std::path::Path;

use nalgebra::{Matrix3x6, Matrix6};
use serde::Deserialize;
use serde_json::Value;
use umi_core::correction::RunCheck;
use umi_core::registration::RigidTransform;
use umi_core::rewrite::{MeasuredIn, RewriteSettings, Rewriter};
use umi_core::units::Point;
use umi_protocol::job::WorkOffset;

use crate::files::points::{name, text};
use crate::problem::Problem;

/// A transform and what it is called in a program's header.
#[derive(Clone, Debug)]
pub struct ProgramSource {
    /// Nominal to measured.
    pub transform: RigidTransform,
    /// Where it holds; none: in the work offset of a program's first motion.
    pub measured_in: Option<MeasuredIn>,
    /// As it stands in the header.
    pub name: String,
    /// The run that was measured, where job and verdict say it: a program that is carried by it
    /// begins with an alarm in any other.
    pub run: Option<RunCheck>,
    /// The run that was measured, where nothing says how a control compares runs, and the file
    /// that says so: what is made of it for a control would run in any other.
    not_compared: Option<(u64, String)>,
    /// The file that leads into machine coordinates, until somebody says the work offset.
    in_machine: Option<String>,
    /// How well a file's transform is known, where it says so.
    known: Option<Known>,
}

/// How well a file's transform is known.
#[derive(Clone, Debug)]
struct Known {
    /// One standard deviation at the worst of its own points.
    at_points_mm: Option<f64>,
    /// Of rotation vector (rad) and translation at the origin (mm).
    cov: Option<Matrix6<f64>>,
    file: String,
}

impl Known {
    /// The expected length of the error at the image of a place, one standard deviation: each axis's
    /// share of [-[R p]x, 1] C [-[R p]x, 1]T (as [`umi_core::registration`] has it).
    fn at_mm(&self, transform: &RigidTransform, place_mm: [f64; 3]) -> Option<f64> {
        let arm = transform.rotation * Point::from_array_mm(place_mm).mm;
        let (mut by, cov) = (Matrix3x6::zeros(), self.cov?);
        by.fixed_columns_mut::<3>(0).copy_from(&-arm.cross_matrix());
        by.fixed_columns_mut::<3>(3).fill_with_identity();
        Some((by * cov * by.transpose()).trace().max(0.0).sqrt())
    }
}

impl ProgramSource {
    /// Of a verdict, with the job that says how runs are compared.
    #[must_use]
    pub const fn of_job(
        transform: RigidTransform,
        measured_in: MeasuredIn,
        name: String,
        run: Option<RunCheck>,
    ) -> Self {
        Self {
            transform,
            measured_in: Some(measured_in),
            name,
            run,
            not_compared: None,
            in_machine: None,
            known: None,
        }
    }

    /// Whether it is known to a limit at its own points and, where its file says so much, at the
    /// corners of a part, nominal.
    ///
    /// # Errors
    /// `expected_error`: one standard deviation of it is more.
    pub fn known_to(&self, limit_mm: f64, part_mm: Option<[[f64; 3]; 2]>) -> Result<(), Problem> {
        let Some(known) = &self.known else {
            return Ok(());
        };
        let refused = |expected_mm: f64, why: std::fmt::Arguments<'_>| {
            Problem::refused(
                "expected_error",
                format_args!("{}: {why}, limit {limit_mm:.4} mm", known.file),
            )
            .with("expected_error_mm", expected_mm)
        };
        if let Some(expected_mm) = known.at_points_mm.filter(|mm| *mm > limit_mm) {
            return Err(refused(
                expected_mm,
                format_args!(
                    "its points disagree: see which residual is the longest and measure that point again, or \
                     give a wider --limit. One standard deviation at the worst of them is {expected_mm:.4} mm"
                ),
            ));
        }
        let Some([low, high]) = part_mm else {
            return Ok(());
        };
        for corner in 0..8 {
            let at = |axis: usize| match corner >> axis & 1 {
                0 => low[axis],
                _ => high[axis],
            };
            let corner_mm = [at(0), at(1), at(2)];
            let expected_mm = known.at_mm(&self.transform, corner_mm);
            if let Some(expected_mm) = expected_mm.filter(|mm| *mm > limit_mm) {
                let [x, y, z] = corner_mm;
                return Err(refused(
                    expected_mm,
                    format_args!(
                        "it is not known well enough as far out as the part reaches: measure points that are \
                         farther apart, around the part, or give a wider --limit. One standard deviation at the \
                         corner {x:.3},{y:.3},{z:.3} is {expected_mm:.4} mm"
                    ),
                ));
            }
        }
        Ok(())
    }

    /// Whether its file says how well it is known anywhere.
    #[must_use]
    pub fn is_known_everywhere(&self) -> bool {
        self.known.as_ref().is_some_and(|known| known.cov.is_some())
    }

    /// The same in a work offset's coordinates: what leads into the machine's is reckoned from its
    /// origin.
    ///
    /// # Errors
    /// `machine_frame`: it leads into the machine's, and nobody says the offset and its origin.
    pub fn in_offset(mut self, place: Option<MeasuredIn>) -> Result<Self, Problem> {
        let Some(file) = &self.in_machine else {
            return Ok(self);
        };
        let Some((place, origin_mm)) = place.and_then(|it| Some((it, it.origin_mm?))) else {
            return Err(Problem::trouble(
                "machine_frame",
                format_args!(
                    "{file}: it says where the part is in machine coordinates: give the work offset in \
                     which the program runs, and its origin (--probed-in G54 and --origin)"
                ),
            ));
        };
        self.transform.translation_mm -= Point::from_array_mm(origin_mm).mm;
        self.measured_in = Some(place);
        self.in_machine = None;
        Ok(self)
    }

    /// Whether a program for a control may be made of it; comparing two programs always may.
    ///
    /// # Errors
    /// `run_not_compared`: the program would run in any run, and one was measured.
    pub fn for_a_control(&self) -> Result<(), Problem> {
        let Some((run, file)) = &self.not_compared else {
            return Ok(());
        };
        Err(Problem::refused(
            "run_not_compared",
            format_args!(
                "{file}: its verdict was measured in run {run}, and a program made from this file \
                 would run in any other, too: how the control compares runs stands in the job that \
                 the board ran, and that is not in the file. Give a journal (umi log -o FILE.umij) \
                 or the board as --verdict; for a trial at a desk give rotation and translation_mm \
                 of its registration as --transform"
            ),
        )
        .with("run", *run))
    }
}

#[derive(Deserialize)]
struct Written {
    /// Rows.
    rotation: [[f64; 3]; 3],
    translation_mm: [f64; 3],
    /// What `umi scan localise` and `umi scan stock` say of it.
    verdict: Option<String>,
    /// What `umi register` says of it.
    suspect: Option<String>,
    expected_error_mm: Option<f64>,
    /// Of rotation vector and translation at the origin.
    cov: Option<[[f64; 6]; 6]>,
    /// From which coordinates into which it leads, as `umi register`, `umi scan localise` and `umi scan stock` say it.
    from: Option<String>,
    to: Option<String>,
}

/// A verdict as `umi replay --json` prints it.
#[derive(Deserialize)]
struct Printed {
    verdict: String,
    plate: u32,
    #[serde(default)]
    reasons: Vec<Value>,
    #[serde(default)]
    reasons_dropped: u64,
    #[serde(default)]
    remarks: Vec<Value>,
    registration: Option<Written>,
    probed_in: Option<WorkOffset>,
    probed_origin_mm: Option<[f64; 3]>,
}

impl Written {
    /// The transform, if it is one: what turns, and neither mirrors nor stretches.
    fn transform(&self, path: &Path) -> Result<RigidTransform, Problem> {
        let transform = RigidTransform::from_rows(self.rotation, self.translation_mm);
        // How far it may lead is the control's matter.
        let turn = RigidTransform::from_rows(self.rotation, [0.0; 3]);
        let [_, _, [_, _, up]] = self.rotation;
        match Rewriter::new(&RewriteSettings::new(turn)) {
            // A tool would come from below.
            Ok(_) if up <= 0.0 => Err(Problem::refused(
                "upside_down",
                format_args!(
                    "{}: it turns the part upside down: in a list of points that lie in a plane a lost \
                     sign, or X and Y exchanged, looks like that; look at the points. Nothing moves by it",
                    name(path)
                ),
            )),
            Ok(_) => Ok(transform),
            Err(bad) => Err(Problem::trouble(
                "transform",
                format_args!("{}: {bad}", name(path)),
            )),
        }
    }
}

/// Reads `{"rotation": [[…], […], […]], "translation_mm": […]}`: what `umi register --json`
/// prints, too.
///
/// # Errors
/// The file cannot be read, or holds something else; a verdict in it is not OK.
pub fn transform(path: &Path) -> Result<ProgramSource, Problem> {
    let written: Written = serde_json::from_str(&text(path)?).map_err(|error| {
        Problem::trouble(
            "transform",
            format_args!(
                "{}: {error}; a transform is {{\"rotation\": [[1,0,0],[0,1,0],[0,0,1]], \
                 \"translation_mm\": [0,0,0]}}",
                name(path)
            ),
        )
    })?;
    if written.verdict.as_ref().is_some_and(|said| said != "OK") {
        return Err(not_ok(path, "its verdict is not OK"));
    }
    if let Some(why) = &written.suspect {
        return Err(not_ok(path, why));
    }
    let refuse = |code, why: std::fmt::Arguments<'_>| {
        Err(Problem::refused(
            code,
            format_args!("{}: {why}", name(path)),
        ))
    };
    if let Some(from) = written.from.as_ref().filter(|from| *from != "part") {
        return refuse(
            "not_of_a_part",
            format_args!(
                "it says where the {from} is, and not where a part is: localise the part (umi scan \
                 localise --part)"
            ),
        );
    }
    let in_machine = match written.to.as_deref() {
        None | Some("offset") => None,
        Some("machine") => Some(name(path)),
        Some(other) => {
            return refuse(
                "frame_unknown",
                format_args!(
                    "it leads into the coordinates of the {other}, and nobody says what these are on the \
                     machine: write it again with --scan-in offset, if they are those of the work offset \
                     in which the program runs, or with --scan-in machine"
                ),
            );
        }
    };
    Ok(ProgramSource {
        transform: written.transform(path)?,
        measured_in: None,
        name: format!("TRANSFORM {}", stem(path)),
        run: None,
        not_compared: None,
        in_machine,
        known: Some(Known {
            at_points_mm: written.expected_error_mm,
            cov: written.cov.map(|rows| Matrix6::from(rows).transpose()),
            file: name(path),
        }),
    })
}

/// Reads the last verdict of what `umi replay --json` printed, up to its end; or one verdict alone.
///
/// # Errors
/// The file cannot be read, a line of it is no JSON, or none is a verdict; the verdict is not OK,
/// something took it back, or the file has no end.
pub fn verdict(path: &Path) -> Result<ProgramSource, Problem> {
    let text = text(path)?;
    let refuse = |why: &dyn std::fmt::Display| {
        Problem::trouble("verdict", format_args!("{}: {why}", name(path)))
    };
    let mut last = None;
    let mut end = None;
    // One verdict, written over many lines; else one a line, each whole: behind one that is cut
    // off another may stand.
    let is_alone = serde_json::from_str::<Value>(&text).is_ok();
    let lines: Vec<&str> = if is_alone {
        vec![&text]
    } else {
        text.lines().collect()
    };
    for (number, line) in (1..).zip(lines).filter(|(_, line)| !line.trim().is_empty()) {
        let value: Value = serde_json::from_str(line).map_err(|error| {
            refuse(&format_args!(
                "line {number} is no JSON ({error}); if it was cut off, write the file again"
            ))
        })?;
        end = (value["type"] == "end").then_some(value["taken_back"] == Value::Bool(false));
        if value["type"] == "verdict" {
            last = Some(line);
        }
    }
    let Some(last) = last else {
        return Err(refuse(
            &"no verdict in it; `umi replay … --json` prints them",
        ));
    };
    let last: Printed = serde_json::from_str(last)
        .map_err(|error| refuse(&format_args!("its last verdict cannot be read: {error}")))?;
    if last.verdict != "OK" {
        return Err(not_ok(path, "its last verdict is NG"));
    }
    if !last.reasons.is_empty() || last.reasons_dropped > 0 {
        return Err(not_ok(
            path,
            "its last verdict says OK and has reasons against it",
        ));
    }
    match end {
        _ if is_alone => {}
        Some(true) => {}
        Some(false) => {
            return Err(Problem::refused(
                "taken_back",
                format_args!(
                    "{}: behind its last verdict the control printed, or bytes were lost: the \
                     board would have taken it back; probe the part again",
                    name(path)
                ),
            ));
        }
        None => {
            return Err(Problem::refused(
                "no_end",
                format_args!(
                    "{}: it does not end as `umi replay --json` does, by a line of type `end`: it \
                     was cut off, and a later clamping may be missing; write it again. Of a board \
                     give the journal (umi log -o FILE.umij)",
                    name(path)
                ),
            ));
        }
    }
    let is_run = |remark: &&Value| remark["code"] == "of_run";
    let run = last.remarks.iter().find(is_run).map(|remark| {
        let run = remark["details"]["run"].as_u64();
        run.ok_or_else(|| refuse(&"the run of its verdict is no whole number"))
    });
    let Some(registration) = last.registration else {
        return Err(refuse(&"its last verdict has no registration"));
    };
    Ok(ProgramSource {
        transform: registration.transform(path)?,
        measured_in: Some(MeasuredIn {
            offset: last.probed_in.unwrap_or(WorkOffset::G54),
            origin_mm: last.probed_origin_mm,
        }),
        name: format!("VERDICT OK - {} - SETUP {}", stem(path), last.plate),
        run: None,
        not_compared: run.transpose()?.map(|run| (run, name(path))),
        in_machine: None,
        known: None,
    })
}

fn not_ok(path: &Path, why: &str) -> Problem {
    Problem::refused(
        "not_ok",
        format_args!("{}: {why}: nothing moves by it", name(path)),
    )
}

fn stem(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    stem.to_string_lossy().chars().take(40).collect()
}
