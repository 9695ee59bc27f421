//! Correction programs on the host: from a verdict of a journal, from a verdict that was
//! printed, or from a transform; in any dialect.

use std::path::Path;

use umi_core::correction::{self, Cleared, Figures, RunCheck};
use umi_core::registration::RigidTransform;
use umi_core::rewrite::MeasuredIn;
use umi_protocol::job::{CorrectionSpec, Job};
use umi_protocol::message::Record;
use umi_protocol::verdict::Verdict;

use crate::board::link::Client;
use crate::files::points::name;
use crate::files::tool_path::{self, ProgramSource};
use crate::journal::audit::Audit;
use crate::journal::{self, FileItem, verify};
use crate::problem::Problem;

/// What a correction is made from.
#[derive(Debug)]
pub enum Basis {
    /// A verdict that a board reached, out of its journal, with the job.
    Judged(Box<(Job, Verdict)>),
    /// A transform, and where it is from. The program says that no board made it.
    Given(Box<ProgramSource>),
}

/// Whose word a journal is to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JournalWord {
    /// A board's: a signed head stands behind the verdict, and the journal's inputs come to it.
    Signed,
    /// That of the board with this key.
    Of([u8; 32]),
    /// Its own: of a board without a key.
    Unsigned,
}

/// Which verdict of a journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhichVerdict {
    /// The last one, as long as the board stood by it.
    Last,
    /// That on a setup of this number.
    Setup(u32),
    /// That of this entry.
    Entry(u64),
}

impl Basis {
    /// A verdict of a journal, or the last one of `umi replay --json`. A journal is to be signed by
    /// its board, by the key if that is known, and to say what its own inputs come to.
    ///
    /// # Errors
    /// The file cannot be read or holds no such verdict, or several on a setup of this number; the
    /// verdict is not OK, or it is the last one and the board took it back. As [`verify::verify`];
    /// `unsigned`: no head vouches for the verdict; `replay_differs`.
    pub fn verdict(path: &Path, which: WhichVerdict, word: &JournalWord) -> Result<Self, Problem> {
        let bytes = journal::load(path)?;
        if umi_core::journal::decode_file(&bytes).is_err() {
            if matches!(word, JournalWord::Of(_)) {
                return Err(Problem::trouble(
                    "usage",
                    "--board-key is for a journal: what umi replay prints is not signed",
                ));
            }
            if which != WhichVerdict::Last {
                return Err(Problem::trouble(
                    "usage",
                    "--plate and --entry are for a journal",
                ));
            }
            return tool_path::verdict(path).map(|source| Self::Given(Box::new(source)));
        }
        let key = match word {
            JournalWord::Of(key) => Some(*key),
            JournalWord::Signed | JournalWord::Unsigned => None,
        };
        let verified = verify::verify(&bytes, key, None)?;
        let mut job = None;
        let mut found = None;
        // Boards count setups from 0 after each start, and in each job. One that is judged again keeps
        // its number, and the last of its verdicts counts.
        let mut wanted: Vec<(u64, Option<u32>)> = Vec::new();
        let mut is_again = false;
        let mut audit = Audit::default();
        let stretch = journal::read(&bytes, |item| {
            let FileItem::Entry(entry) = item else {
                // Another job may have been set in between, and another verdict reached.
                job = None;
                is_again = false;
                if which == WhichVerdict::Last {
                    found = None;
                }
                audit.gap();
                return Ok(());
            };
            let record = journal::record(&entry);
            if let Ok(record) = &record {
                audit.take(&entry, record);
            }
            match record {
                Ok(Record::JobSet { job: set, .. }) => {
                    job = Some(set);
                    is_again = false;
                    if which == WhichVerdict::Last {
                        found = None;
                    }
                }
                Ok(Record::Verdict(verdict)) => {
                    let is_wanted = match which {
                        WhichVerdict::Last => true,
                        WhichVerdict::Setup(setup) => verdict.setup == setup,
                        WhichVerdict::Entry(seq) => entry.seq == seq,
                    };
                    if core::mem::replace(&mut is_again, is_wanted) && is_wanted {
                        wanted.pop();
                    }
                    if is_wanted {
                        wanted.push((entry.seq, verdict.of_run()));
                        found = job.clone().map(|job: Job| (job, verdict));
                    }
                }
                _ => {}
            }
            Ok::<(), Problem>(())
        })?;
        if let (WhichVerdict::Setup(setup), [_, _, ..]) = (which, wanted.as_slice()) {
            let each: Vec<String> = wanted
                .iter()
                .map(|(seq, run)| match run {
                    Some(run) => format!("--entry {seq} (run {run})"),
                    None => format!("--entry {seq}"),
                })
                .collect();
            return Err(Problem::refused(
                "ambiguous_setup",
                format_args!(
                    "{}: {} setups have the number {setup}, as a board counts them anew after each start and \
                     in each job: name the verdict by its entry: {}",
                    name(path),
                    each.len(),
                    each.join(", ")
                ),
            ));
        }
        let is_taken_back = audit.taken_back();
        if let Some((seq, _)) = wanted.last()
            && *word != JournalWord::Unsigned
        {
            if verified.signed_to.is_none_or(|to| to <= *seq) {
                return Err(Problem::refused(
                    "unsigned",
                    format_args!(
                        "{}: no head that the board has signed vouches for the verdict in entry {seq}: \
                         whoever had the file can have made it; pull the journal again (umi log pull), \
                         or ask the board (--verdict board). Of a board without a key: --unsigned",
                        name(path)
                    ),
                ));
            }
            if let Some((entry, difference)) = audit.finish(stretch.next).differences.first() {
                return Err(Problem::refused(
                    "replay_differs",
                    format_args!(
                        "{}: entry {entry} is not what the entries before it come to: {difference}; \
                         see umi replay. Nothing is corrected by this journal",
                        name(path)
                    ),
                ));
            }
        }
        match found {
            // Who names one looks back.
            Some((_, verdict)) if which == WhichVerdict::Last && verdict.ok && is_taken_back => {
                Err(Problem::refused(
                    "taken_back",
                    format_args!(
                        "{}: behind its last verdict, OK on setup {}, the control printed, \
                         the probe touched, bytes were lost or teaching was asked for again, or the verdict \
                         became older than the job's `plate_timeout_s`: the board has taken it back; probe the part again, or, if nothing was moved \
                         since, name the verdict: --entry {}",
                        name(path),
                        verdict.setup,
                        wanted.last().map_or(0, |(seq, _)| *seq)
                    ),
                ))
            }
            Some(judged) => Ok(Self::Judged(Box::new(judged))),
            None => Err(Problem::trouble(
                "verdict",
                format_args!("{}: {}", name(path), none_there(!wanted.is_empty(), which)),
            )),
        }
    }

    /// The latest verdict of a board, as long as the board stands by it.
    ///
    /// # Errors
    /// The link's; the board has no job, reached no verdict, or has taken its OK back.
    pub fn board(board: &mut Client) -> Result<Self, Problem> {
        let before = board.status()?;
        let (job, verdict) = (board.job()?.job, board.verdict()?);
        // On both sides: what comes in between belongs to another verdict.
        let after = board.status()?;
        let stands = [&before, &after].map(|status| status.last_verdict_ok) == [Some(true); 2]
            && before.verdicts == after.verdicts;
        match (job, verdict) {
            (Some(_), Some(verdict)) if verdict.ok && !stands => Err(Problem::refused(
                "taken_back",
                format_args!(
                    "the board has taken back its OK on setup {}: since then the control printed, \
                     the probe touched, teaching was asked for again, or it is older than the \
                     job's `plate_timeout_s`; probe the part again",
                    verdict.setup
                ),
            )),
            (Some(job), Some(verdict)) => Ok(Self::Judged(Box::new((job, verdict)))),
            _ => Err(Problem::trouble(
                "verdict",
                "the board has reached no verdict with the job in force",
            )),
        }
    }

    /// The same in a work offset's coordinates, as [`ProgramSource::in_offset`].
    ///
    /// # Errors
    /// As there.
    pub fn in_offset(self, place: Option<MeasuredIn>) -> Result<Self, Problem> {
        match self {
            Self::Given(source) => Ok(Self::Given(Box::new(source.in_offset(place)?))),
            judged @ Self::Judged(_) => Ok(judged),
        }
    }

    /// Whether it is known to a limit at the part: a verdict has been held to its job's.
    ///
    /// # Errors
    /// As [`ProgramSource::known_to`].
    pub fn known_to(&self, limit_mm: f64, part_mm: Option<[[f64; 3]; 2]>) -> Result<(), Problem> {
        match self {
            Self::Given(source) => source.known_to(limit_mm, part_mm),
            Self::Judged(_) => Ok(()),
        }
    }

    /// Whether it says how well it is known anywhere, so that a program's reach matters.
    #[must_use]
    pub fn is_known_everywhere(&self) -> bool {
        match self {
            Self::Given(source) => source.is_known_everywhere(),
            Self::Judged(_) => false,
        }
    }

    /// The transform, nominal to measured: for what is compared and goes to no control.
    ///
    /// # Errors
    /// The verdict is not OK, or the setup was taught and nothing moves by it.
    pub fn transform(&self) -> Result<RigidTransform, Problem> {
        match self {
            Self::Given(source) => Ok(source.transform),
            Self::Judged(judged) => cleared(&judged.1).map(|(_, transform)| transform),
        }
    }

    /// Where the transform holds, as far as it is known.
    #[must_use]
    pub fn measured_in(&self) -> Option<MeasuredIn> {
        match self {
            Self::Given(source) => source.measured_in,
            Self::Judged(judged) => Some(MeasuredIn::of(judged.0.correction.as_ref())),
        }
    }

    /// The transform, where it is from, and the run that a program compares: for a control.
    ///
    /// # Errors
    /// As [`transform`](Self::transform); the program could not compare the run that was measured.
    pub fn source(&self) -> Result<ProgramSource, Problem> {
        let (job, verdict) = match self {
            Self::Given(source) => {
                source.for_a_control()?;
                return Ok(ProgramSource::clone(source));
            }
            Self::Judged(judged) => &**judged,
        };
        let (_, transform) = cleared(verdict)?;
        let run = verdict.of_run();
        let spec = job
            .correction
            .as_ref()
            .zip(job.guards.run_variable)
            .zip(run);
        let check = |((spec, variable), run): ((&CorrectionSpec, u32), u32)| {
            let dialect = spec.dialect;
            RunCheck::of(dialect, variable, run).ok_or_else(|| {
                let said = format!(
                    "a rewritten program for {} compares no run, and the job has `run_variable`: \
                     take it out of a job by which programs are rewritten",
                    dialect.name()
                );
                Problem::refused("not_compared", said)
            })
        };
        let check = spec.map(check).transpose()?;
        let of_run = run.map_or_else(String::new, |run| format!(" - RUN {run}"));
        let name = format!(
            "VERDICT OK - {} - SETUP {}{of_run}",
            job.name, verdict.setup
        );
        let measured_in = MeasuredIn::of(job.correction.as_ref());
        Ok(ProgramSource::of_job(transform, measured_in, name, check))
    }

    /// The correction that the job asks for.
    #[must_use]
    pub fn spec(&self) -> Option<CorrectionSpec> {
        match self {
            Self::Judged(judged) => judged.0.correction,
            Self::Given(_) => None,
        }
    }
}

/// A correction program.
#[derive(Clone, Debug)]
pub struct Made {
    /// The text, lines ended by LF.
    pub text: String,
    /// Largest error that it leaves at the part's corners.
    pub leftover_mm: f64,
}

/// Makes the program.
///
/// # Errors
/// The verdict is not OK; the dialect has not the place that is asked for; the numbers do not
/// fit its format; what would be left is more than the limit, or a transform is known less well.
pub fn make(basis: &Basis, spec: &CorrectionSpec) -> Result<Made, Problem> {
    let dialect = spec.dialect.name();
    correction::dialect::check(spec).map_err(|field| {
        let place = field.name().trim_start_matches("correction.");
        Problem::trouble(
            "usage",
            format_args!("{dialect} has no such `{place}`; `umi dialects` lists what it has"),
        )
    })?;
    let not_expressible = |correction::NotExpressible| {
        Problem::refused(
            "not_expressible",
            format_args!("the correction does not fit the numbers of {dialect}"),
        )
    };
    let (transform, judged) = match basis {
        Basis::Given(source) => {
            source.for_a_control()?;
            source.known_to(spec.leftover_mm, Some([spec.part_min_mm, spec.part_max_mm]))?;
            (source.transform, None)
        }
        Basis::Judged(judged) => {
            let (job, verdict) = &**judged;
            let (cleared, transform) = cleared(verdict)?;
            let run = job.guards.run_variable.zip(verdict.of_run());
            if let Some((variable, run)) = run
                && RunCheck::of_correction(spec.dialect, variable, run).is_none()
            {
                return Err(Problem::refused(
                    "not_compared",
                    format_args!(
                        "the verdict was measured in run {run}, and a correction in the words of {dialect} \
                         compares no run: it would set any other one, too; take a dialect that does, or \
                         take `run_variable` out of the job"
                    ),
                )
                .with("run", run));
            }
            let rms_mm = verdict.registration.as_ref().map_or(f64::NAN, |r| r.rms_mm);
            let (turn_deg, tilt_deg) = transform.turn_and_tilt_deg();
            let figures = Figures {
                job: &job.name,
                setup: verdict.setup,
                rms_mm,
                turn_deg,
                tilt_deg,
                run,
            };
            (transform, Some((cleared, figures)))
        }
    };
    let plan = correction::plan(spec, &transform).map_err(not_expressible)?;
    let leftover_mm = plan.uncorrected.0;
    if leftover_mm > spec.leftover_mm {
        return Err(Problem::refused(
            "leftover",
            format_args!(
                "{dialect} would leave {leftover_mm:.4} mm at the part's corners, limit {:.4} mm; \
                 `umi dialects` says which control can do more, `umi nc rewrite` needs none",
                spec.leftover_mm
            ),
        )
        .with("leftover_mm", leftover_mm)
        .with("limit_mm", spec.leftover_mm));
    }
    let text = match (basis, &judged) {
        (_, Some((cleared, figures))) => correction::write(cleared, spec, &plan, figures),
        (Basis::Given(source), None) => correction::write_given(spec, &plan, &source.name),
        // `judged` is made of the basis.
        (Basis::Judged(_), None) => Err(correction::NotExpressible),
    }
    .map_err(not_expressible)?;
    Ok(Made {
        text: text.as_str().to_owned(),
        leftover_mm,
    })
}

/// The motion of a verdict that is OK.
fn cleared(verdict: &Verdict) -> Result<(Cleared, RigidTransform), Problem> {
    let setup = verdict.setup;
    let cleared = Cleared::by(verdict).ok_or_else(|| {
        Problem::refused("not_ok", format_args!("the verdict on setup {setup} is NG"))
    })?;
    let Some(registration) = &verdict.registration else {
        return Err(Problem::refused(
            "no_registration",
            "the setup was taught: it is the reference, and nothing is to be corrected",
        ));
    };
    let transform = RigidTransform::from_rows(registration.rotation, registration.translation_mm);
    Ok((cleared, transform))
}

/// Why a journal has no verdict to correct by; `is_seen`: what was asked for stands in it.
const fn none_there(is_seen: bool, which: WhichVerdict) -> &'static str {
    match (is_seen, which) {
        (false, _) => "no such verdict in it",
        (true, WhichVerdict::Last) => {
            "its last verdict is of before the board's last start, or of another job than the last one in \
             it: probe the part again, or, if nothing was moved since, name the verdict (--entry, see umi log)"
        }
        (true, _) => {
            "the job by which that was judged is not in it: pull the journal from an earlier entry (umi log \
             without --from)"
        }
    }
}
