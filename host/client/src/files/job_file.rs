//! Job files: TOML to a checked job, with errors that name file, line and column.

use std::fmt;
use std::ops::Range;
use std::path::Path;

use toml::de::{DeTable, DeValue};
use umi_core::correction::dialect::compares_runs;
use umi_core::dprnt::{ConfigError, check_config};
use umi_core::job::{moves_something, says_run};
use umi_protocol::job::{Dialect, Job, Reference, Teach};
use umi_protocol::job_error::{Field, JobError};

use crate::files::points::{name, text};
use crate::problem::Problem;

/// Reads and checks a job file, `-` for standard input.
///
/// # Errors
/// The file cannot be read; it is no job (`Problem::Refused`, `job_syntax`); the
/// job cannot be used (`Problem::Refused`, with the code of the [`JobError`]).
pub fn load(path: &Path) -> Result<Job, Problem> {
    parse(&text(path)?).map_err(|fault| fault.in_file(path))
}

/// A job for a session whose end nobody can wait for: a capture, a virtual machine's run.
#[derive(Clone, Debug)]
pub struct SessionJob {
    /// The job. Where its file does not say `teach`, the first OK setup teaches: nobody can
    /// ask for it in what was captured.
    pub job: Job,
    /// The file does not say `teach`, and a board would teach when asked.
    pub teach_is_missing: bool,
}

/// As [`load`], for a session that is replayed or simulated.
///
/// # Errors
/// As [`load`].
pub fn load_for_session(path: &Path) -> Result<SessionJob, Problem> {
    let source = text(path)?;
    let mut job = parse(&source).map_err(|fault| fault.in_file(path))?;
    let teach_is_missing = job.teach == Teach::Asked && !says_teach(&source);
    if teach_is_missing {
        job.teach = Teach::FirstOk;
    }
    Ok(SessionJob {
        job,
        teach_is_missing,
    })
}

/// A job as the text of a job file.
///
/// # Errors
/// A job that no file can hold; none is known.
pub fn write(job: &Job) -> Result<String, Problem> {
    toml::to_string_pretty(job).map_err(|error| {
        Problem::trouble("job", format_args!("this job cannot be written: {error}"))
    })
}

/// What is wrong with a job file, and where.
#[derive(Clone, Debug, PartialEq)]
pub struct JobFault {
    /// Stable name: `job_syntax`, or that of the [`JobError`].
    pub code: &'static str,
    /// What is wrong and what is allowed.
    pub message: String,
    /// Where, if it is in one place.
    pub place: Option<TextPlace>,
}

/// A place in a text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TextPlace {
    /// From 1.
    pub line: usize,
    /// From 1, in characters.
    pub column: usize,
    /// The line's text.
    pub text: String,
}

/// Reads and checks a job.
///
/// One that moves something, or could (three datum features make a registration), and does not
/// say `teach` teaches when asked: nothing is a reference because it came first. In records of
/// boards an absent `teach` remains [`Teach::FirstOk`], as they were when they were written.
///
/// # Errors
/// What is wrong with it.
pub fn parse(source: &str) -> Result<Job, JobFault> {
    let mut job: Job = toml::from_str(source).map_err(|error| JobFault {
        code: "job_syntax",
        message: in_words(error.message()),
        place: error.span().map(|span| TextPlace::of(source, &span)),
    })?;
    let is_taught = job.reference == Reference::Taught;
    if is_taught && moves_something(&job) && !says_teach(source) {
        job.teach = Teach::Asked;
    }
    umi_core::job::check(&job).map_err(|error| refused(source, &job, &error))?;
    Ok(job)
}

/// Whether the file says what makes a setup the reference.
fn says_teach(source: &str) -> bool {
    let table = DeTable::parse(source);
    table.is_ok_and(|table| table.get_ref().contains_key("teach"))
}

/// A board's or this tool's refusal of a job that is not in a file.
#[must_use]
pub fn refusal(error: &JobError) -> Problem {
    let problem = Problem::refused(error.code(), message(error));
    match error {
        JobError::BeyondCeiling {
            field,
            ceiling,
            given,
        } => problem
            .with("field", field.name())
            .with("ceiling", *ceiling)
            .with("given", *given),
        JobError::WitnessDemanded => problem
            .with("field", "require_witness")
            .with("ceiling", true)
            .with("given", false),
        _ => problem,
    }
}

fn refused(source: &str, job: &Job, error: &JobError) -> JobFault {
    JobFault {
        code: error.code(),
        message: match (receiver_error(job, error), guard_error(job, error)) {
            (Some(error), _) => format!("`receiver`: {error}"),
            (None, Some(why)) => why,
            (None, None) => message(error),
        },
        place: find(source, job, error).map(|span| TextPlace::of(source, &span)),
    }
}

/// The receiver's own words, where it is the receiver that is refused.
fn receiver_error(job: &Job, error: &JobError) -> Option<ConfigError> {
    match error {
        JobError::BadValue {
            field: Field::Receiver,
            ..
        } => check_config(&job.receiver).err(),
        _ => None,
    }
}

/// What a guard lacks, where it is not the value alone: what stands elsewhere in the job.
fn guard_error(job: &Job, error: &JobError) -> Option<String> {
    let JobError::BadValue { field, .. } = error else {
        return None;
    };
    let key = match field {
        Field::RunVariable => "guards.run_variable",
        Field::Frame if job.guards.frame => "guards.frame",
        _ => return None,
    };
    let is_frame = *field == Field::Frame;
    let Some(correction) = &job.correction else {
        return Some(format!(
            "`{key}` needs a [correction]: {}; give one, with `send = \"never\"` where programs are \
             rewritten instead, or leave `{key}` out",
            if is_frame {
                "it says in which work offset is probed, and with which values"
            } else {
                "its `dialect` says how the control compares"
            }
        ));
    };
    if !says_run(job) {
        return Some(format!(
            "`{key}` needs the lines of openumi's macros (hw/control), which say their run: \
             patterns = [{{ checked = {{}} }}], or blocks and {{ checked = {{}} }} behind them; with \
             other patterns leave `{key}` out"
        ));
    }
    let variable = job.guards.run_variable.filter(|_| !is_frame)?;
    let dialect = correction.dialect;
    if !compares_runs(dialect) {
        return Some(format!(
            "`{key}`: a correction for {} compares no runs; leave it out, and each verdict says so \
             (`umi dialects` lists what others can)",
            dialect.name()
        ));
    }
    let (why, take) = match (dialect, variable) {
        (Dialect::HaasVariables, _) => ("is none that O8830 compares", "531"),
        (Dialect::Siemens, _) => ("is no R parameter", "0 to 999, as many as MD28050 says"),
        (Dialect::Heidenhain, _) => ("is no QR parameter, which is kept", "0 to 499"),
        (Dialect::LinuxCnc, _) => (
            "is a parameter of a call, or LinuxCNC's own",
            "31 to 5000, listed in its parameter file (the macros take 4531)",
        ),
        (_, 0..=33) => (
            "is a local variable, which ends with its program",
            "500 to 999 (the macros take 531)",
        ),
        (_, 100..=199) => (
            "is cleared when the control is switched off, and the runs would begin anew",
            "500 to 999 (the macros take 531)",
        ),
        (_, 1000..) => (
            "is a system variable, or one that not every control has",
            "500 to 999 (the macros take 531)",
        ),
        _ => ("is no common variable", "500 to 999 (the macros take 531)"),
    };
    Some(format!("`{key}`: #{variable} {why}; give {take}"))
}

/// What the TOML reader says, without the types of a programming language.
fn in_words(message: &str) -> String {
    // A list with a fixed number of places names that of the first entry that finds none.
    let too_many = message.strip_prefix("invalid length ").and_then(|rest| {
        let (length, expected) = rest.split_once(", ")?;
        let places = length.parse::<u32>().ok()?.checked_sub(1)?;
        (expected == "expected a sequence").then_some(places)
    });
    if let Some(places) = too_many {
        return format!("too many entries: at most {places} here; take the others out");
    }
    let kinds = [
        ("expected u8", "expected a whole number, 0 to 255"),
        ("expected u16", "expected a whole number, 0 to 65535"),
        ("expected u32", "expected a whole number, 0 or more"),
        ("expected f64", "expected a number"),
        ("expected a boolean", "expected true or false"),
        (
            "expected an array of length 3",
            "expected three numbers in brackets",
        ),
        ("expected a sequence", "expected a list in brackets"),
        ("expected a map", "expected a table"),
    ];
    let known = kinds.iter().find_map(|(kind, words)| {
        let before = message.strip_suffix(kind)?;
        Some(format!("{before}{words}"))
    });
    known.unwrap_or_else(|| message.to_owned())
}

/// Where in the file the receiver's fault is.
fn find_in_receiver(table: &DeTable<'_>, error: &ConfigError) -> Option<Range<usize>> {
    let key = match error {
        ConfigError::Travel { .. } => "travel_mm",
        ConfigError::NoTimeout => "idle_timeout_s",
        ConfigError::NoPatterns => "patterns",
        ConfigError::Format { pattern }
        | ConfigError::Header { pattern }
        | ConfigError::Table { pattern }
        | ConfigError::Axes { pattern }
        | ConfigError::Ignored { pattern }
        | ConfigError::Label { pattern }
        | ConfigError::Template { pattern, .. } => {
            let patterns = table.get("receiver")?.get_ref().get("patterns")?.get_ref();
            let place = usize::from(*pattern).checked_sub(1)?;
            return patterns.get(place).map(toml::Spanned::span);
        }
    };
    path_span(table, &["receiver", key])
}

/// What is wrong, and for a value also what is allowed.
fn message(error: &JobError) -> String {
    match error {
        JobError::BadValue { field, .. } => format!("{error}; {}", allowed(*field)),
        _ => error.to_string(),
    }
}

const fn allowed(field: Field) -> &'static str {
    match field {
        Field::PlateTimeoutS => "give seconds, 1 or more",
        Field::PositionMm | Field::ProbedOriginMm | Field::PartMinMm => {
            "give three finite numbers, in mm"
        }
        Field::PartMaxMm => "give three finite numbers, in mm, none smaller than in `part_min_mm`",
        Field::PretravelMm => "give 0 or more, and less than `tip_radius_mm`",
        Field::RotationDeg | Field::TiltDeg | Field::ApproachDeg => "give degrees above 0",
        Field::ProgramNumber => "give 1 to 9999",
        Field::Approach => "give +x, -x, +y, -y, +z or -z for each hit",
        Field::Receiver => "see the patterns, the travel and the time-out",
        Field::CountsPerMm => {
            "give counts per mm of X, Y and Z, none 0, negative if they count down"
        }
        Field::Closing => {
            "name two features of one kind with a position, and `within_mm` above 0; it repeats one that repeats none itself"
        }
        Field::Fixed => "name features with a position, of a job with `reference = \"taught\"`",
        Field::Learned => "give `radius_mm`, `rms_mm` and `centring_mm` above 0",
        Field::Probing => {
            "give `sigma_mm` from 0.000001 to 1, one number or one for each of X, Y and Z, and `dof` of 1 or more"
        }
        Field::Warmth => "give `expansion_ppm_per_k` and `at_most_k` above 0",
        Field::RunVariable => {
            "give the number of the variable that the macros count runs in, with checked lines and a dialect that can compare (not grbl)"
        }
        Field::Frame => "it needs checked lines, and a correction",
        Field::OriginCounts => "give three finite numbers, in counts",
        Field::FeedMmPerMin => "give mm/min above 0",
        Field::DelayMs => "give milliseconds above 0",
        Field::WriteTo => "give an offset that the dialect has; `umi dialects` lists them",
        Field::Set => "give one that the dialect has, or none; `umi dialects` lists them",
        Field::LineBaud => "give 300 to 230400",
        Field::LineDataBits => "give 7 (and a parity bit) or 8 (and none)",
        Field::LineStopBits => "give 1 or 2",
        Field::LineRtsCts => "give true or false",
        Field::SkipActive => "give high or low",
        Field::SkipMinWidthUs => "give 0 to 10000 microseconds",
        Field::SkipHoldOffMs => "give 1 to 1000 milliseconds",
        Field::SkipDelayUs => "give 0 to 100000 microseconds",
        Field::SkipEachHit => "give true: without it and without `[witness]` no touch is looked at",
        Field::Again => {
            "give a length above 0, and with it at least one sphere of 6 hits or more whose `approach` begins and ends alike"
        }
        Field::RadiusMm
        | Field::TipRadiusMm
        | Field::RadiusErrorMm
        | Field::RmsMm
        | Field::DistanceErrorMm
        | Field::RegistrationRmsMm
        | Field::ShiftMm
        | Field::ExpectedErrorMm
        | Field::LoneHitMm
        | Field::ToleranceMm
        | Field::UncorrectedMm
        | Field::FixedMm
        | Field::NominalDistanceMm => "give millimetres above 0",
    }
}

/// Where in the file the fault is.
fn find(source: &str, job: &Job, error: &JobError) -> Option<Range<usize>> {
    let table = DeTable::parse(source).ok()?;
    let table = table.get_ref();
    let feature = |name: &str| job.features.iter().position(|f| f.name == name);
    if let Some(error) = receiver_error(job, error) {
        return find_in_receiver(table, &error);
    }
    let in_feature = |at: Option<usize>, key: &str| {
        let list = table.get("features")?.get_ref();
        let feature = list.get(at?)?;
        let found = feature.get_ref().as_table().and_then(|t| key_span(t, key));
        Some(found.unwrap_or(feature.span()))
    };
    match error {
        JobError::BadName => key_span(table, "name"),
        JobError::NoFeatures | JobError::TooFewDatums { .. } | JobError::TooManyDatums { .. } => {
            key_span(table, "features")
        }
        JobError::DuplicateFeature { name } => {
            // The second of them is the one to change.
            let last = job.features.iter().rposition(|f| f.name == *name);
            in_feature(last, "name")
        }
        JobError::BadFeatureName { feature } => {
            in_feature(usize::from(*feature).checked_sub(1), "name")
        }
        JobError::HitCount { name, .. } => in_feature(feature(name), "hits"),
        JobError::ApproachCount { name, .. } => in_feature(feature(name), "approach"),
        JobError::Missing { field, feature: of }
        | JobError::BadValue {
            field, feature: of, ..
        } => match of {
            Some(name) => in_feature(feature(name), field.name()),
            None => path_span(table, &path(*field)),
        },
        // Of a board, not of a file.
        JobError::BeyondCeiling { field, .. } => path_span(table, &path(*field)),
        JobError::WitnessDemanded | JobError::TooOften => None,
        JobError::DegenerateReference => in_feature(Some(0), "position_mm"),
        JobError::SameOffset => path_span(table, &["correction", "write_to"]),
        JobError::NoPatterns | JobError::UnnamedFeatures | JobError::WitnessPairing => {
            path_span(table, &["receiver", "patterns"])
        }
        JobError::WitnessCompensation => key_span(table, "compensation"),
        JobError::NotOnThisBoard { field } => path_span(table, &path(*field)),
        JobError::ParityMissing | JobError::CodingLacks => {
            path_span(table, &["receiver", "coding"])
        }
    }
}

/// The keys that lead to a field outside of features.
fn path(field: Field) -> Vec<&'static str> {
    match field {
        Field::TipRadiusMm | Field::PretravelMm => vec!["compensation", "on_board", field.name()],
        _ => field.name().split('.').collect(),
    }
}

/// Where the last key of a path stands, or of as much of it as is there.
fn path_span(table: &DeTable<'_>, path: &[&str]) -> Option<Range<usize>> {
    let (first, rest) = path.split_first()?;
    let here = key_span(table, first)?;
    let deeper = table.get(*first).map(toml::Spanned::get_ref);
    let deeper = deeper.and_then(DeValue::as_table);
    Some(deeper.and_then(|t| path_span(t, rest)).unwrap_or(here))
}

fn key_span(table: &DeTable<'_>, key: &str) -> Option<Range<usize>> {
    table.get_key_value(key).map(|(key, _)| key.span())
}

impl TextPlace {
    fn of(source: &str, span: &Range<usize>) -> Self {
        let before = source.get(..span.start).unwrap_or(source);
        let start = before.rfind('\n').map_or(0, |newline| newline + 1);
        let text = source.get(start..).unwrap_or_default().lines().next();
        Self {
            line: before.matches('\n').count() + 1,
            column: before.get(start..).unwrap_or_default().chars().count() + 1,
            text: text.unwrap_or_default().trim_end().to_owned(),
        }
    }
}

impl fmt::Display for TextPlace {
    /// The line with a mark under the column.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = self.line.to_string();
        let mark = self.column - 1 + number.len() + 3;
        write!(f, "{number} | {}\n{:mark$}^", self.text, "")
    }
}

impl JobFault {
    /// The same with the name of its file, and the place in it.
    #[must_use]
    pub fn in_file(self, path: &Path) -> Problem {
        let file = name(path);
        let Some(place) = self.place else {
            let message = format!("{file}: {}", self.message);
            return Problem::refused(self.code, message).with("file", file);
        };
        let TextPlace { line, column, .. } = place;
        let message = format!("{file}:{line}:{column}: {}\n\n{place}", self.message);
        Problem::refused(self.code, message)
            .with("file", file)
            .with("line", line)
            .with("column", column)
    }
}

#[cfg(test)]
mod tests;
