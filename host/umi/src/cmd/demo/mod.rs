//! `umi demo`

mod localise;

use std::path::{Path, PathBuf};

use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{FAINT, GOOD, TITLE, Table, count, paint, print, print_json};
use clap::builder::PossibleValuesParser;
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use umi_client::files::job_file;
use umi_client::journal::audit::{Audit, Findings};
use umi_client::journal::{self, PullRequest, PullStep, Stretch};
use umi_client::session::Fact;
use umi_desk::capture::Desk;
use umi_experiment::thesis::cases::{self, ExperimentCase};
use umi_experiment::thesis::outcome::{
    ExperimentOutcome, ExperimentSummary, Method, Setting, Surface, spread,
};
use umi_experiment::thesis::path::Passes;
use umi_experiment::thesis::printed as thesis;
use umi_experiment::thesis::run::{self, ExperimentProgress};
use umi_report::terminal;
use umi_virtual::cutting::DeviationStatistics;

use super::Format;
use localise::DemoLocalise;

/// The thesis' experiment: misplace a part, probe it, correct, cut, measure what was cut
#[derive(Args)]
#[command(after_help = HELP, args_conflicts_with_subcommands = true)]
pub(crate) struct Demo {
    #[command(subcommand)]
    other: Option<OtherDemo>,
    /// Where the report, all programs and the journal go
    #[arg(long, value_name = "DIR", default_value = "umi-demo")]
    out: PathBuf,
    /// Seed of all random errors
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Run with this many seeds, one after the other, and state the spread
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// Without error sources
    #[arg(long)]
    ideal: bool,
    /// Distance of two passes of the finishing path on the surface; the thesis has 0.541
    #[arg(long, value_name = "MM", default_value_t = STEPOVER_MM)]
    stepover_mm: f64,
    /// Clamp as the thesis' registrations say (table 4.2), not as its text says
    #[arg(long)]
    printed_poses: bool,
    /// By what the clampings are corrected: a dialect that an interpreter here knows, or the
    /// finishing program itself rewritten
    #[arg(long, value_name = "REMEDY", default_value = "g10-g68", value_parser = remedies())]
    remedy: String,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

/// Other demonstrations.
#[derive(Subcommand)]
enum OtherDemo {
    Localise(DemoLocalise),
}

/// The page; a folder that has one is of an older run.
const REPORT: &str = "report.html";

/// The names of the remedies.
fn remedies() -> PossibleValuesParser {
    Method::ALL.map(Method::name).into()
}

/// Cusps of 1.2 µm: small against the 2 µm that are to be shown.
const STEPOVER_MM: f64 = 0.2;

/// Pitch of the measured nodes in X and Y, mm. Along the passes little changes; across
/// them the pitch is no part of the stepover, so that nodes stand everywhere on a cusp.
const PITCH_MM: [f64; 2] = [0.5, 0.0437];

const HELP: &str = "\
The experiment of A. Sawula's thesis (2013, chapters 4 and 5) on a virtual machine: a plate with
three spheres and a workpiece is clamped five times (nominal; +1 degree; -1 degree and +16 mm;
+1 degree and -48 mm; -2 degrees and -35 mm in X). In each clamping the control probes the spheres
by the thesis' routine, its serial line goes byte by byte into a virtual board, the board registers
the plate and gives the correction back, and a fifth of the surface is finished with it. Then the
surface is measured; a second workpiece is cut without corrections for contrast.

Error sources are those of the thesis' table 5.5 and the control's delay of 0 to 4 ms, nothing else;
--ideal switches them off. Figures are of what a tool has cut; the share that none has is stated.

Examples:
  umi demo
  umi demo --force                      over the last one
  umi demo --ideal --out /tmp/ideal
  umi demo --seeds 10
  umi demo --stepover-mm 0.541 --printed-poses
  umi demo --ideal --printed-poses --remedy rewritten
  umi demo --json | jq 'select(.type==\"surface\")'";

impl Demo {
    pub fn run(self) -> Result<(), Failure> {
        if let Some(OtherDemo::Localise(demo)) = self.other {
            return demo.run();
        }
        // A wrong stepover is told before anything is written.
        Passes::new(self.stepover_mm).map_err(|fault| Failure::trouble("stepover", fault))?;
        self.force.check(&self.out.join(REPORT), &[])?;
        std::fs::create_dir_all(&self.out)
            .map_err(|error| Failure::file("write", &self.out, &error))?;
        let cases = if self.printed_poses {
            cases::printed()
        } else {
            cases::stated()
        };
        let bar = ProgressBar::new(self.seeds * run::steps(&cases) as u64).with_style(style());
        let (mut outcome, mut bench) = self.one(self.seed, &cases, &bar, true)?;
        let mut summaries = vec![outcome.summary()];
        for more in 1..self.seeds {
            let (other, _) = self.one(self.seed.wrapping_add(more), &cases, &bar, false)?;
            summaries.push(other.summary());
        }
        bar.finish_and_clear();

        let (entries, findings) = self.pull(&mut bench)?;
        if let Some((seq, difference)) = findings.differences.first() {
            return Err(Failure::refused(
                "audit",
                format_args!("journal entry {seq}: {difference}"),
            ));
        }
        self.write_programs(&outcome)?;
        outcome.session.facts = facts(&outcome, entries, &findings);
        let page = self.out.join(REPORT);
        std::fs::write(
            &page,
            umi_experiment::thesis::pages::html(&outcome, &summaries),
        )
        .map_err(|error| Failure::file("write", &page, &error))?;
        if self.format.json {
            self.print_json(&outcome, &summaries, &page, entries, findings.identical)?;
        } else {
            self.print_text(&outcome, &summaries, &page, entries, findings.identical)?;
        }
        if outcome.session.setups.iter().all(|setup| setup.verdict.ok) {
            Ok(())
        } else {
            Err(Failure::Negative)
        }
    }

    /// The one with the name; the parser lets no other name through.
    fn remedy(&self) -> Method {
        let named = Method::ALL.into_iter().find(|r| r.name() == self.remedy);
        named.unwrap_or(Method::ALL[0])
    }

    /// One run; the first one is shown as it goes.
    fn one(
        &self,
        seed: u64,
        cases: &[ExperimentCase],
        bar: &ProgressBar,
        shown: bool,
    ) -> Result<(ExperimentOutcome, Desk), Failure> {
        let setting = Setting {
            seed,
            ideal: self.ideal,
            stepover_mm: self.stepover_mm,
            pitch_mm: PITCH_MM,
            remedy: self.remedy(),
        };
        run::run(&setting, cases, |progress| {
            match progress {
                ExperimentProgress::Step { case, what } => {
                    bar.set_message(format!("seed {seed}, case {case}: {what}"));
                    bar.inc(1);
                }
                ExperimentProgress::Decision(decision) if shown && self.format.json => {
                    print_json(&crate::show::json::decision(decision))?;
                }
                ExperimentProgress::Judged(session, place) if shown && !self.format.json => {
                    let table = terminal::setup(session, place, true);
                    bar.suspend(|| print(&format!("{table}\n")))?;
                }
                ExperimentProgress::Decision(_) | ExperimentProgress::Judged(..) => {}
            }
            Ok(())
        })
    }

    /// Every program that ran, as the control had it, with scene and job: what
    /// `umi machine run` takes.
    fn write_programs(&self, outcome: &ExperimentOutcome) -> Result<(), Failure> {
        let write = |name: &str, text: &str| {
            let path = self.out.join(name);
            std::fs::write(&path, text).map_err(|error| Failure::file("write", &path, &error))
        };
        for (name, text) in run::MEMORY {
            write(name, text)?;
        }
        write("scene.toml", run::SCENE)?;
        write("job.toml", &job_file::write(&run::job()?)?)?;
        for (what, programs) in [
            ("correction", &outcome.corrections),
            ("finish", &outcome.programs),
        ] {
            for (case, program) in programs.iter().enumerate() {
                if let Some(text) = program {
                    write(&format!("case-{case}-{what}.nc"), text)?;
                }
            }
        }
        Ok(())
    }

    /// Pulls the journal into a file and replays it.
    fn pull(&self, bench: &mut Desk) -> Result<(u64, Findings), Failure> {
        let mut file = Vec::new();
        let mut audit = Audit::default();
        let pulled = journal::pull(bench.client(), PullRequest::default(), |step| {
            match step {
                PullStep::Header(header, _) => file.extend_from_slice(&header.encode()),
                PullStep::Gap(gap) => {
                    file.extend_from_slice(&gap.encode());
                    audit.gap();
                }
                PullStep::Entry(entry, raw) => {
                    file.extend_from_slice(raw);
                    let record = journal::record(&entry)
                        .map_err(|unreadable| Failure::refused("unreadable", unreadable))?;
                    audit.take(&entry, &record);
                }
            }
            Ok::<(), Failure>(())
        })?;
        let path = self.out.join("journal.umij");
        std::fs::write(&path, file).map_err(|error| Failure::file("write", &path, &error))?;
        let Stretch { first, next, .. } = pulled.stretch;
        Ok((next - first, audit.finish(next)))
    }

    fn print_text(
        &self,
        outcome: &ExperimentOutcome,
        summaries: &[ExperimentSummary],
        page: &Path,
        entries: u64,
        identical: u64,
    ) -> Result<(), Failure> {
        let mut text = terminal::summary(&outcome.session, true);
        text += &format!("\n{}\n", surface_table(outcome));
        text += &format!(
            "  {}\n",
            paint(
                FAINT,
                format_args!(
                    "deviation where a tool has cut, \u{b5}m; seed {}, {} passes {:.3} mm apart (cusps {:.1} \u{b5}m), {}",
                    outcome.setting.seed,
                    outcome.passes.count(),
                    outcome.passes.stepover_mm(),
                    outcome.passes.cusp_mm() * 1e3,
                    if outcome.setting.ideal {
                        "no error sources"
                    } else {
                        "error sources: table 5.5 and the control\u{2019}s delay, no scanner"
                    },
                )
            )
        );
        if summaries.len() > 1 {
            text += &format!("\n{}", seed_table(summaries));
        }
        print(&format!(
            "{text}\n{} {entries} entries, {identical} decisions replayed identical to the last bit\n\
             {}  {}\n",
            paint(TITLE, "journal"),
            paint(GOOD, "report"),
            page.display(),
        ))
    }

    fn print_json(
        &self,
        outcome: &ExperimentOutcome,
        summaries: &[ExperimentSummary],
        page: &Path,
        entries: u64,
        identical: u64,
    ) -> Result<(), Failure> {
        for (case, plane) in outcome.planes.iter().enumerate() {
            print_json(&json!({
                "type": "plate_surface",
                "case": case,
                "points": plane.points,
                "centroid_mm": plane.centroid_mm,
                "normal": plane.normal,
                "sigma_mm": plane.std_mm,
            }))?;
        }
        for (corrected, surface) in [(true, &outcome.corrected), (false, &outcome.uncorrected)] {
            print_json(&json!({
                "type": "surface",
                "corrected": corrected,
                "seed": outcome.setting.seed,
                "ideal": outcome.setting.ideal,
                "stepover_mm": outcome.passes.stepover_mm(),
                "cusp_mm": outcome.passes.cusp_mm(),
                "whole": statistics(&surface.whole),
                "cases_1_to_4_against_case_0": surface.against_first.as_ref().map(statistics),
                "sections": surface.sections.iter().map(statistics).collect::<Vec<_>>(),
                "crashes": surface.crashes,
            }))?;
        }
        if summaries.len() > 1 {
            for summary in summaries {
                print_json(&json!({
                    "type": "seed",
                    "seed": summary.seed,
                    "corrected": statistics(&summary.corrected),
                    "cases_1_to_4_against_case_0": summary.against_first.as_ref().map(statistics),
                    "uncorrected": statistics(&summary.uncorrected),
                }))?;
            }
        }
        print_json(&json!({
            "type": "demo",
            "report": page.display().to_string(),
            "journal_entries": entries,
            "decisions_replayed_identical": identical,
        }))
    }
}

/// Figures of the nodes that were cut; null where none was.
fn statistics(figures: &DeviationStatistics) -> Value {
    let cut = |mm: f64| (figures.cut() > 0).then_some(mm);
    json!({
        "nodes": figures.nodes,
        "uncut": figures.uncut,
        "share_uncut": figures.share_uncut(),
        "mean_mm": cut(figures.mean_mm),
        "std_mm": cut(figures.std_mm),
        "min_mm": cut(figures.min_mm),
        "max_mm": cut(figures.max_mm),
        "mean_above_mm": cut(figures.mean_above_mm),
        "mean_below_mm": cut(figures.mean_below_mm),
    })
}

/// The finished surface, and the thesis'.
fn surface_table(outcome: &ExperimentOutcome) -> Table {
    let mut table = Table::new("<>>>>>>>").titles(&[
        "surface",
        "mean",
        "above",
        "below",
        "std. dev.",
        "smallest",
        "largest",
        "not cut",
    ]);
    let um = |mm: f64| format!("{:+.1}", mm * 1e3);
    for printed in &thesis::SURFACES {
        table.row([
            format!("thesis, cases 1-4 against 0, {}", printed.place),
            "-".into(),
            um(printed.above_mm),
            um(printed.below_mm),
            format!("{:.1}", printed.std_mm * 1e3),
            "-".into(),
            "-".into(),
            "-".into(),
        ]);
    }
    let mut row = |name: String, figures: &DeviationStatistics| {
        let cut = |text: String| match figures.cut() {
            0 => "-".into(),
            _ => text,
        };
        table.row([
            name,
            cut(um(figures.mean_mm)),
            cut(um(figures.mean_above_mm)),
            cut(um(figures.mean_below_mm)),
            cut(format!("{:.1}", figures.std_mm * 1e3)),
            cut(um(figures.min_mm)),
            cut(um(figures.max_mm)),
            format!("{:.1} %", 100.0 * figures.share_uncut()),
        ]);
    };
    let mut rows = |name: &str, surface: &Surface| {
        if let Some(figures) = &surface.against_first {
            row(
                format!("{name}, cases 1-4 against 0, as the thesis"),
                figures,
            );
        }
        row(format!("{name}, whole, against nominal"), &surface.whole);
        for (section, figures) in surface.sections.iter().enumerate() {
            row(format!("{name}, section {section}"), figures);
        }
    };
    rows("corrected", &outcome.corrected);
    rows("uncorrected", &outcome.uncorrected);
    table
}

/// All seeds, and how far they spread.
fn seed_table(summaries: &[ExperimentSummary]) -> Table {
    let figures: [fn(&ExperimentSummary) -> f64; 9] = [
        |s| s.against_first.map_or(f64::NAN, |s| s.mean_above_mm),
        |s| s.against_first.map_or(f64::NAN, |s| s.mean_below_mm),
        |s| s.against_first.map_or(f64::NAN, |s| s.std_mm),
        |s| s.corrected.mean_mm,
        |s| s.corrected.mean_above_mm,
        |s| s.corrected.mean_below_mm,
        |s| s.corrected.std_mm,
        |s| s.corrected.min_mm,
        |s| s.corrected.max_mm,
    ];
    // A section 0 that was not cut leaves nothing to compare with.
    let um = |mm: f64| match mm {
        mm if mm.is_nan() => "-".into(),
        mm => format!("{:+.2}", mm * 1e3),
    };
    let mut table = Table::new("<>>>>>>>>>>").titles(&[
        "seed",
        "1-4/0: above",
        "below",
        "std. dev.",
        "whole: mean",
        "above",
        "below",
        "std. dev.",
        "smallest",
        "largest",
        "uncorrected",
    ]);
    for summary in summaries {
        let mut row = vec![summary.seed.to_string()];
        row.extend(figures.map(|figure| um(figure(summary))));
        row.push(um(summary.uncorrected.mean_mm));
        table.row(row);
    }
    let uncorrected: fn(&ExperimentSummary) -> f64 = |s| s.uncorrected.mean_mm;
    let all = figures.into_iter().chain([uncorrected]);
    let (means, stds): (Vec<f64>, Vec<f64>) = all.map(|figure| spread(summaries, figure)).unzip();
    for (name, values) in [("mean", means), ("spread", stds)] {
        table.row(
            [name.to_owned()]
                .into_iter()
                .chain(values.into_iter().map(um)),
        );
    }
    table
}

fn facts(outcome: &ExperimentOutcome, entries: u64, findings: &Findings) -> Vec<Fact> {
    let fact = |label: &str, value: String| Fact {
        label: label.into(),
        value,
    };
    let programs = outcome.corrections.iter().flatten().count();
    let astray = outcome
        .position_error_mm
        .iter()
        .copied()
        .fold(0.0, f64::max);
    vec![
        fact(
            "Input",
            format!(
                "{} bytes as printed by the control, {:.1} hours on the machine",
                outcome.printed_bytes,
                outcome.machine_s / 3600.0
            ),
        ),
        fact(
            "Misplaced",
            format!("points of the path are up to {astray:.1} mm off if nothing is corrected"),
        ),
        fact(
            "Contacts of the tool that were no cuts",
            format!(
                "{} corrected, {} uncorrected",
                outcome.corrected.crashes, outcome.uncorrected.crashes
            ),
        ),
        fact(
            "Journal",
            format!(
                "{entries} entries, pulled and verified; {} replayed, identical to the last bit",
                count(findings.identical, "decision")
            ),
        ),
        fact(
            "READ",
            format!(
                "{programs} correction programs taken from the control\u{2019}s port, byte for byte as reported"
            ),
        ),
    ]
}

fn style() -> ProgressStyle {
    ProgressStyle::with_template("{bar:40} {pos}/{len} {msg}")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
}
