//! `umi replay`

use std::path::{Path, PathBuf};

use crate::failure::Failure;
use crate::show::terminal::{BAD, CAUTION, GOOD, count, paint, print, print_error, print_json};
use clap::Args;
use serde_json::json;
use umi_client::files::capture::CaptureLook;
use umi_client::journal::audit::{Audit, Findings};
use umi_client::journal::guarding::Guarding;
use umi_client::journal::verify::VerifiedFile;
use umi_client::journal::{self, FileItem};
use umi_client::session::DecisionRecord;
use umi_client::session::SessionBuilder;
use umi_desk::capture::Desk;
use umi_protocol::access::AccessMode;
use umi_protocol::job::{CorrectionSpec, Job};
use umi_protocol::message::Record;
use umi_protocol::records::fault::{Fault, FaultCode};
use umi_report::terminal;

use super::log::signed_by;
use crate::cmd::{Format, session_job};

/// A captured byte file through a virtual board, or the audit of a journal
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Replay {
    /// Bytes as they came from a control, in any code; or a journal as pulled by
    /// `umi log`
    #[arg(value_name = "SESSION|FILE.umij")]
    file: PathBuf,
    /// The job for the bytes; a journal brings its own
    #[arg(long, value_name = "JOB.toml")]
    job: Option<PathBuf>,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
The bytes go, piece by piece, into the control's port of a virtual board, and what
is printed came over its link: one JSON object a line with --json, in the order in
which things happened (type: feature, fault, verdict; at the end end, which says whether
what came behind the last verdict took it back).

A journal's inputs go through the same program once more, and every decision is
compared with the one in the journal, bit for bit (type: audit).

Examples:
  umi replay monday.txt --job examples/three-spheres.toml
  umi replay monday.txt --job examples/three-spheres.toml --json | jq .verdict
  umi replay monday.umij

Exit status: 0 replayed, whatever the verdicts say; 1 a file or the job; 2 the
journal is faulty, or a decision is not the same.";

impl Replay {
    pub fn run(self) -> Result<(), Failure> {
        let bytes = journal::load(&self.file)?;
        if umi_core::journal::decode_file(&bytes).is_ok() {
            // What nobody would vouch for is not replayed.
            let verified = journal::verify::verify(&bytes, None, None)?;
            return self.audit(&bytes, &verified);
        }
        let Some(job) = &self.job else {
            return Err(Failure::trouble(
                "no_job",
                format_args!(
                    "{} is no journal: say with --job what its lines mean",
                    self.file.display()
                ),
            ));
        };
        self.capture(&bytes, job)
    }

    fn capture(&self, bytes: &[u8], job: &Path) -> Result<(), Failure> {
        let job = session_job(job)?;
        let mut bench = Desk::new(&job)?;
        let mut shown = Shown::new(&job, self.format.json);
        bench.play(bytes, |decision| shown.take(decision))?;
        bench.end(|decision| shown.take(decision))?;
        let measured = shown.features > 0;
        shown.finish()?;
        if self.format.json {
            let stands = bench.client().status()?.last_verdict_ok.is_some();
            self.end(!stands)?;
        }
        if !measured {
            let look = CaptureLook::of(bytes).nothing_measured(&job.receiver);
            print_error(&format!("{} {look}\n", paint(CAUTION, "note")));
        }
        Ok(())
    }

    fn audit(&self, bytes: &[u8], verified: &VerifiedFile) -> Result<(), Failure> {
        let mut audit = Audit::default();
        let mut shown: Option<Shown> = None;
        let mut board = Guarding::default();
        let json = self.format.json;
        let stretch = journal::read(bytes, |item| {
            let FileItem::Entry(entry) = item else {
                audit.gap();
                return Ok(());
            };
            let record = journal::record(&entry)
                .map_err(|unreadable| Failure::refused("unreadable", unreadable))?;
            audit.take(&entry, &record);
            let mode = board.follow(entry.seq, &record);
            if let Record::JobSet { job, .. } = &record {
                // The setups of another job are another session.
                if let Some(shown) = shown.replace(Shown::new(job, json)) {
                    shown.finish()?;
                }
            }
            match (DecisionRecord::of(record), &mut shown) {
                (Some(decision), Some(shown)) => {
                    shown.board = Some(mode);
                    shown.take(decision)
                }
                _ => Ok(()),
            }
        })?;
        if let Some(shown) = shown {
            shown.finish()?;
        }
        let taken_back = audit.taken_back();
        self.report(&audit.finish(stretch.next), taken_back, verified)
    }

    /// Closes what is printed for machines: behind it nothing takes the last verdict back.
    fn end(&self, taken_back: bool) -> Result<(), Failure> {
        print_json(&json!({"type": "end", "taken_back": taken_back}))
    }

    fn report(
        &self,
        findings: &Findings,
        taken_back: bool,
        verified: &VerifiedFile,
    ) -> Result<(), Failure> {
        let Findings {
            identical,
            differences,
            skipped,
        } = findings;
        if self.format.json {
            let differences: Vec<_> = differences
                .iter()
                .map(|(seq, difference)| json!({"seq": seq, "message": difference.to_string()}))
                .collect();
            print_json(&json!({
                "type": "audit",
                "identical": identical,
                "differences": differences,
                "skipped": skipped,
                "signed": verified.signed,
                "key_id": verified.key.as_ref().map(journal::key_id),
            }))?;
            self.end(taken_back)?;
        } else {
            if *skipped > 0 {
                let what = count(*skipped, "record");
                print(&format!(
                    "{} before the first start that the journal still holds: not replayed\n",
                    paint(CAUTION, what)
                ))?;
            }
            for (seq, difference) in differences {
                print(&format!(
                    "{} entry {seq}: {difference}\n",
                    paint(BAD, "differs")
                ))?;
            }
            if *identical == 0 && differences.is_empty() {
                let what = "it holds no decision that could be replayed";
                print(&format!("{}\n", paint(CAUTION, what)))?;
            } else if differences.is_empty() {
                let what = count(*identical, "decision");
                let what = format!("{what} replayed, identical to the last bit");
                print(&format!("{}\n", paint(GOOD, what)))?;
            }
            print(&format!("{}\n", signed_by(verified)))?;
        }
        if differences.is_empty() {
            Ok(())
        } else {
            Err(Failure::Negative)
        }
    }
}

/// Decisions as they are shown.
struct Shown {
    gather: SessionBuilder,
    json: bool,
    correction: Option<CorrectionSpec>,
    features: u64,
    /// Who might do what with a journal's board; a capture is of none.
    board: Option<Option<AccessMode>>,
    alike: Alike,
}

/// Faults of one name that follow each other: a text that came twice has one for each of its lines.
#[derive(Default)]
struct Alike {
    code: Option<FaultCode>,
    shown: u64,
    /// How many are not shown, and the last of them.
    more: Option<(u64, Box<Fault>)>,
}

impl Alike {
    /// So many are shown in full.
    const SHOWN: u64 = 3;

    fn take(&mut self, fault: &Fault) -> Result<(), Failure> {
        if self.code != Some(fault.code()) {
            self.end()?;
            self.code = Some(fault.code());
        }
        if self.shown < Self::SHOWN {
            self.shown += 1;
            return print(&format!("{} {fault}\n", paint(CAUTION, "fault")));
        }
        let more = self.more.take().map_or(1, |(more, _)| more + 1);
        self.more = Some((more, Box::new(fault.clone())));
        Ok(())
    }

    /// Tells what was not shown.
    fn end(&mut self) -> Result<(), Failure> {
        match std::mem::take(self).more {
            Some((1, fault)) => print(&format!("{} {fault}\n", paint(CAUTION, "fault"))),
            Some((more, fault)) => {
                let what = count(more, "fault");
                print(&format!(
                    "{what} more of this kind (all by --json), the last: {fault}\n"
                ))
            }
            None => Ok(()),
        }
    }
}

impl Shown {
    fn new(job: &Job, json: bool) -> Self {
        let gather = SessionBuilder::new("Replay", "", job, None);
        Self {
            gather,
            json,
            correction: job.correction,
            features: 0,
            board: None,
            alike: Alike::default(),
        }
    }

    fn take(&mut self, decision: DecisionRecord) -> Result<(), Failure> {
        self.features += u64::from(matches!(decision, DecisionRecord::Feature(_)));
        if self.json {
            let mut value = crate::show::json::decision(&decision);
            if let DecisionRecord::Verdict(_) = &decision {
                if let Some(mode) = self.board {
                    value["access"] = json!(mode);
                }
                if let Some(spec) = &self.correction {
                    value["probed_in"] = json!(spec.probed_in);
                    value["probed_origin_mm"] = json!(spec.probed_origin_mm);
                }
            }
            print_json(&value)?;
        } else if let DecisionRecord::Fault(fault) = &decision {
            self.alike.take(fault)?;
        }
        let judged = self.gather.take(decision);
        match judged {
            Some(place) if !self.json => {
                self.alike.end()?;
                let setup = terminal::setup(&self.gather.session, place, true);
                print(&format!("{setup}\n"))?;
                match self.board {
                    Some(Some(AccessMode::Open)) => {
                        print(&format!("{}\n", paint(CAUTION, "board open")))
                    }
                    _ => Ok(()),
                }
            }
            _ => Ok(()),
        }
    }

    fn finish(mut self) -> Result<(), Failure> {
        if self.json {
            return Ok(());
        }
        self.alike.end()?;
        print(&terminal::summary(&self.gather.session, true))
    }
}
