//! `umi demo`

use std::path::{Path, PathBuf};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use umi::audit::Audit;
use umi::capture::{Bench, Decision};
use umi::failure::Failure;
use umi::gather::Gather;
use umi::jobfile;
use umi::pull::{self, Step};
use umi::report::{self, Fact, Session, Truth, terminal};
use umi::style::{GOOD, TITLE, count, paint, print, print_json};

use super::Format;

/// Five clampings of a three-sphere plate through a virtual board
#[derive(Args)]
#[command(after_help = HELP)]
pub struct Demo {
    /// Where the report, the correction programs and the journal go
    #[arg(long, value_name = "DIR", default_value = "umi-demo")]
    out: PathBuf,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
The clampings are those of A. Sawula's thesis (2013, section 4.3): nominal; +1 degree;
-1 degree and +16 mm; +1 degree and -48 mm; -2 degrees and -35 mm in X. Their hits, with
the probe's pretravel and noise, go byte by byte as a control prints them into a virtual
board; everything shown came back over its link. After each verdict the control presses
READ and gets the correction program.

Examples:
  umi demo
  umi demo --out /tmp/demo
  umi demo --json | jq 'select(.type==\"verdict\") | .verdict'";

/// The session as printed, its true poses, and the job for it.
const CAPTURE: &str = include_str!("../../../../tests/reference/sessions/session_a.txt");
const ANSWERS: &str = include_str!("../../../../tests/reference/sessions/session_a.json");
const JOB: &str = include_str!("../../../../examples/three-spheres.toml");

const CASES: [(&str, &str); 5] = [
    ("Case 0", "nominal clamping: it is taught"),
    ("Case 1", "turned by +1 degree about Z"),
    ("Case 2", "turned by -1 degree, moved by +16 mm in X"),
    ("Case 3", "turned by +1 degree, moved by -48 mm in X"),
    ("Case 4", "turned by -2 degrees, moved by -35 mm in X"),
];

/// Lines that the control prints for one clamping: three blocks of nine.
const LINES: usize = 27;

impl Demo {
    pub fn run(self) -> Result<(), Failure> {
        let failed = |error| Failure::file("write", &self.out, &error);
        std::fs::create_dir_all(&self.out).map_err(failed)?;
        let job = jobfile::parse(JOB).map_err(|fault| Failure::trouble("demo", fault.message))?;
        let answers: Value =
            serde_json::from_str(ANSWERS).map_err(|error| Failure::trouble("demo", error))?;

        let mut bench = Bench::new(&job)?;
        let mut gather = Gather::new(
            "Three spheres, five clampings",
            "Hits as a control prints them, through the receiver, fits, registration, verdict \
             and correction of a virtual openumi board; everything here came over its link. The \
             spheres, the probe's pretravel and noise, and the true poses are those of a \
             computed session after A. Sawula's thesis (2013, section 4.3).",
            &job,
            Some(&bench.identity().clone()),
        );
        gather.session.path_points_mm = answers["path_points"]
            .as_array()
            .map(|points| points.iter().filter_map(triple).collect())
            .unwrap_or_default();

        let bar = ProgressBar::new(CAPTURE.len() as u64).with_style(style());
        let lines: Vec<&str> = CAPTURE.split_inclusive('\n').collect();
        let mut programs = 0_u64;
        for (case, clamping) in lines.chunks(LINES).enumerate() {
            let mut decisions = Vec::new();
            for line in clamping {
                bar.inc(line.len() as u64);
                bench.play(line.as_bytes(), |decision| {
                    decisions.push(decision);
                    Ok(())
                })?;
            }
            for decision in decisions {
                self.take(&mut gather, decision, &answers, &bar)?;
            }
            programs += u64::from(self.fetch(&mut bench, &gather.session, case)?);
        }
        bar.finish_and_clear();

        let (entries, findings) = self.pull(&mut bench)?;
        if let Some((seq, difference)) = findings.differences.first() {
            return Err(Failure::refused(
                "audit",
                format_args!("journal entry {seq}: {difference}"),
            ));
        }
        let fact = |label: &str, value: String| Fact {
            label: label.into(),
            value,
        };
        gather.session.facts = vec![
            fact(
                "Input",
                format!("{} bytes as printed by the control", CAPTURE.len()),
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
                    "{programs} correction programs taken from the control's port, byte for byte as reported"
                ),
            ),
        ];
        let page = self.out.join("report.html");
        std::fs::write(&page, report::html(&gather.session)).map_err(failed)?;
        self.sum_up(&gather.session, &page, entries, findings.identical)
    }

    /// Takes a decision in and shows it.
    fn take(
        &self,
        gather: &mut Gather,
        decision: Decision,
        answers: &Value,
        bar: &ProgressBar,
    ) -> Result<(), Failure> {
        if self.format.json {
            print_json(&match &decision {
                Decision::Feature(feature) => umi::json::feature(feature),
                Decision::Verdict(verdict) => umi::json::verdict(verdict),
                Decision::Fault(fault) => umi::json::fault(fault),
            })?;
        }
        let Some(place) = gather.take(decision) else {
            return Ok(());
        };
        let plate = &mut gather.session.plates[place];
        if let Some((title, about)) = CASES.get(place) {
            plate.title = (*title).into();
            plate.about = (*about).into();
        }
        plate.truth = truth(&answers["truth"]["poses"][place]);
        if self.format.json {
            return Ok(());
        }
        let table = terminal::plate(&gather.session, place, true);
        bar.suspend(|| print(&format!("{table}\n")))
    }

    /// The control presses READ. What it gets must be the program of the verdict,
    /// and nothing where the verdict has none.
    fn fetch(&self, bench: &mut Bench, session: &Session, case: usize) -> Result<bool, Failure> {
        let correction = session
            .plates
            .get(case)
            .and_then(|plate| plate.verdict.correction.as_ref());
        let Some(correction) = correction else {
            return Ok(false);
        };
        let program = bench.read_program()?;
        if program.as_deref() != Some(correction.text.as_str()) {
            return Err(Failure::refused(
                "demo",
                format_args!("case {case}: the control got another program than the verdict holds"),
            ));
        }
        let path = self.out.join(format!("case-{case}-correction.nc"));
        std::fs::write(&path, correction.text.as_str())
            .map_err(|error| Failure::file("write", &path, &error))?;
        Ok(true)
    }

    /// Pulls the journal into a file and replays it.
    fn pull(&self, bench: &mut Bench) -> Result<(u64, umi::audit::Findings), Failure> {
        let mut file = Vec::new();
        let mut audit = Audit::default();
        let stretch = pull::pull(bench.client(), None, |step| {
            match step {
                Step::Header(header, _) => file.extend_from_slice(&header.encode()),
                Step::Entry(entry, raw) => {
                    file.extend_from_slice(raw);
                    let record = pull::record(&entry)
                        .map_err(|unreadable| Failure::refused("unreadable", unreadable))?;
                    audit.take(&entry, &record);
                }
            }
            Ok(())
        })?;
        let path = self.out.join("journal.umij");
        std::fs::write(&path, file).map_err(|error| Failure::file("write", &path, &error))?;
        Ok((stretch.next - stretch.first, audit.finish(stretch.next)))
    }

    fn sum_up(
        &self,
        session: &Session,
        page: &Path,
        entries: u64,
        identical: u64,
    ) -> Result<(), Failure> {
        let all_ok = session.plates.iter().all(|plate| plate.verdict.ok);
        if self.format.json {
            print_json(&json!({
                "type": "demo",
                "report": page.display().to_string(),
                "journal_entries": entries,
                "decisions_replayed_identical": identical,
            }))?;
        } else {
            print(&terminal::summary(session, true))?;
            print(&format!(
                "\n{} {entries} entries, {identical} decisions replayed identical to the last bit\n\
                 {}  {}\n",
                paint(TITLE, "journal"),
                paint(GOOD, "report"),
                page.display(),
            ))?;
        }
        if all_ok {
            Ok(())
        } else {
            Err(Failure::Negative)
        }
    }
}

fn truth(pose: &Value) -> Option<Truth> {
    let rows = pose["R"].as_array()?;
    let [x, y, z] = rows.as_slice() else {
        return None;
    };
    Some(Truth {
        rotation: [triple(x)?, triple(y)?, triple(z)?],
        translation_mm: triple(&pose["t"])?,
    })
}

fn triple(value: &Value) -> Option<[f64; 3]> {
    Some([value[0].as_f64()?, value[1].as_f64()?, value[2].as_f64()?])
}

fn style() -> ProgressStyle {
    ProgressStyle::with_template("{bar:40} {bytes}/{total_bytes} from the control")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
}
