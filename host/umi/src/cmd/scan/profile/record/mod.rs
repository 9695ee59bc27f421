//! `umi scan record`

mod sensor;

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use umi_client::timeline::{Follower, LatchTally};
use umi_scan::ScanError;
use umi_scan::format::profiles;
use umi_scan::format::triggers::{self, LatchSignal};
use umi_scan::pair::{ScanPairing, pair};

use super::pair::Tolerances;
use crate::cmd::record::events::{Following, Rhythm, Scan, Sink, seconds};
use crate::cmd::{Board, Format};
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{BAD, CAUTION, GOOD, count, paint, print, print_error, print_json};
use sensor::{SensorCame, SensorFile, address, connect};

/// Records a scan: the sensor's profiles and the board's latches, as they come
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Record {
    #[command(flatten)]
    board: Board,
    /// The sensor's data channel; without a port 3196, a Gocator's
    #[arg(long, value_name = "tcp:HOST[:PORT]", value_parser = address)]
    sensor: String,
    /// Where profiles.gocator, triggers.csv and record.json go
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Stop after this many seconds; without, at Ctrl-C
    #[arg(long = "for", value_name = "SECONDS", value_parser = seconds)]
    lasting: Option<Duration>,
    #[command(flatten)]
    scan: Scan,
    /// Pulses in time begin at once with their interval, without a signature
    #[arg(long, requires = "trigger_every_us")]
    even: bool,
    #[command(flatten)]
    tolerances: Tolerances,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
With --trigger-every-us, or --axis and a distance, the board triggers the sensor. Without them
the sensor triggers the board. Start the sensor on its own page before; this command connects
to its data channel first, then the board's pulses begin. Pulses in time begin with a
signature: some stretches of other intervals, so that a lost first frame shifts nothing.
A pulse is 20 us long, which a Gocator takes; --trigger-width-us and --trigger-rests change it.
A line that is crossed before the pulse before and 20 us behind it are over has no pulse: it is
told as lost.

Both files are written as they come. If this program or its computer stops, what is there can
be read: profiles end between two messages, latches between two lines. At the end the profiles
are paired with the latches, and record.json says what came of it. --encoder, --jitter-us, --drift-ppm,
--frame-bits and --counter-restarts are those of `umi scan pair`; they change nothing of the files.

Examples:
  umi scan record --port /dev/ttyACM0 --sensor tcp:192.168.1.10 -o scan1 --trigger-every-us 5000
  umi scan record --sensor tcp:192.168.1.10 -o scan2 --trigger-every-mm 0.1 --axis y --laser
  umi scan record --sensor tcp:192.168.1.10 -o scan2 --encoder y --jitter-us 40
  umi scan record --port tcp://127.0.0.1:5053 --sensor tcp:127.0.0.1:5054 -o scan3 --for 20
then
  umi scan merge scan1/profiles.gocator scan1/triggers.csv --machine machine.toml -o cloud.ply

Exit status: 0 nothing was lost and all was paired, 1 file, usage or connection, 2 something
was lost, or the profiles cannot be paired (the files are there all the same).";

/// Without a profile for so long while pulses go out, somebody should look.
const SILENCE: Duration = Duration::from_secs(3);

/// A loss is told at once, and more of it once in this time.
const PAUSE: Duration = Duration::from_secs(1);

impl Record {
    pub fn run(self) -> Result<(), Failure> {
        let file = |name: &str| self.output.join(name);
        let (capture, table, summary) = (
            file("profiles.gocator"),
            file("triggers.csv"),
            file("record.json"),
        );
        for path in [&capture, &table, &summary] {
            self.force.check(path, &[])?;
        }
        // Nothing is made or replaced before both are there.
        let mut board = self.board.connect()?;
        let channel = connect(&self.sensor)?;
        let is_new = !self.output.exists();
        std::fs::create_dir_all(&self.output)
            .map_err(|error| Failure::file("write", &self.output, &error))?;
        for path in [&capture, &table, &summary] {
            match std::fs::remove_file(path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    return Err(Failure::file("write", path, &error));
                }
                _ => {}
            }
        }
        let sensor = SensorFile::begin(channel, &capture)?;
        let mut sink = Sink::table(&table)?;
        let mut follower = Follower::default();
        let mut view = View::new(self.format.json);
        let following = Following {
            scan: &self.scan,
            lasting: self.lasting,
            rhythm: if self.even {
                Rhythm::Even
            } else {
                Rhythm::Signed
            },
        };
        let followed = following.run(&mut board, &mut sink, &mut follower, &mut |sink, tally| {
            view.turn(&sensor.came(), sink.shown, tally)
        });
        let came = sensor.end();
        let kept = sink.close();
        view.bar.finish_and_clear();
        if followed.is_err() && came.profiles == 0 && sink.shown == 0 {
            // Refused before anything came: nothing is left of it. If that fails, the refusal is what matters.
            let _ = std::fs::remove_file(&capture);
            let _ = std::fs::remove_file(&table);
            if is_new {
                let _ = std::fs::remove_dir(&self.output);
            }
            return followed;
        }
        followed.map_err(|failure| sink.kept(failure))?;
        kept?;
        let pairing = self.pairing(&capture, &table);
        self.tell(&came, &follower.tally, sink.shown, &pairing, &summary)
    }

    fn pairing(&self, capture: &Path, table: &Path) -> Result<ScanPairing, ScanError> {
        let cause = if self.scan.has_pulses() {
            LatchSignal::Output
        } else {
            LatchSignal::Trigger
        };
        let latches = triggers::read(table, Some(cause))?;
        let came = profiles::stamps(capture)?;
        let mut pairing = pair(&came.stamps, &latches, &self.tolerances.options(false))?;
        pairing.warnings.extend(came.warning());
        Ok(pairing)
    }

    fn tell(
        &self,
        came: &SensorCame,
        tally: &LatchTally,
        latches: u64,
        pairing: &Result<ScanPairing, ScanError>,
        summary: &Path,
    ) -> Result<(), Failure> {
        let paired = match pairing {
            Ok(pairing) => json!({
                "paired": pairing.pairs.len(),
                "unpaired_profiles": pairing.unpaired_profiles.len(),
                "unpaired_triggers": pairing.unpaired_triggers.len(),
                "lost_frames": pairing.lost_frames,
                "missed_latches": pairing.missed_latches,
                "clock": { "offset_us": pairing.clock.offset_us,
                           "drift_ppm": pairing.clock.drift_ppm },
                "warnings": pairing.warnings,
            }),
            Err(error) => json!({ "error": { "code": error.code, "message": error.message } }),
        };
        let is_lossy = tally.lost() || came.lost + came.repeated > 0 || came.ended.is_some();
        let all_paired = pairing.as_ref().is_ok_and(|pairing| {
            pairing.unpaired_profiles.len() + pairing.unpaired_triggers.len() == 0
        });
        let value = json!({
            "type": "end",
            "profiles": came.profiles,
            "repeated": came.repeated,
            "lost_frames": came.lost,
            "restarts": came.restarts,
            "latches": latches,
            "latches_lost": tally.latches_lost,
            "positions_lost": tally.positions_lost,
            "events_lost": tally.events_lost,
            "sensor_ended": came.ended,
            "pairing": paired,
            "folder": self.output.display().to_string(),
        });
        std::fs::write(summary, format!("{value:#}\n"))
            .map_err(|error| Failure::file("write", summary, &error))?;
        if self.format.json {
            print_json(&value)?;
        } else {
            print(&self.words(came, tally, latches, pairing))?;
        }
        if is_lossy || !all_paired {
            return Err(Failure::Negative);
        }
        Ok(())
    }

    fn words(
        &self,
        came: &SensorCame,
        tally: &LatchTally,
        latches: u64,
        pairing: &Result<ScanPairing, ScanError>,
    ) -> String {
        let mut text = format!(
            "{}, {} in {}\n",
            count(came.profiles, "profile"),
            latches_in_words(latches),
            self.output.display()
        );
        text += &match losses(came, tally).as_slice() {
            [] => paint(GOOD, "nothing lost on the way") + "\n",
            lost => paint(BAD, format_args!("lost: {}", lost.join(", "))) + "\n",
        };
        text + &match pairing {
            Ok(pairing) => {
                let paired = format!(
                    "{} paired, {} without a latch, {} without a profile\n",
                    count(pairing.pairs.len() as u64, "profile"),
                    count(pairing.unpaired_profiles.len() as u64, "profile"),
                    latches_in_words(pairing.unpaired_triggers.len() as u64),
                );
                let warnings = pairing.warnings.iter();
                paired
                    + &warnings
                        .map(|of| paint(CAUTION, of) + "\n")
                        .collect::<String>()
            }
            Err(error) => paint(BAD, format_args!("not paired: {error}")) + "\n",
        }
    }
}

fn latches_in_words(n: u64) -> String {
    format!("{n} latch{}", if n == 1 { "" } else { "es" })
}

/// What was lost, in words.
fn losses(came: &SensorCame, tally: &LatchTally) -> Vec<String> {
    let mut lost: Vec<String> = [
        (came.lost, "of the sensor's frames"),
        (tally.latches_lost, "edges and latches"),
        (tally.positions_lost, "times the axes: positions are wrong"),
        (tally.events_lost, "events"),
    ]
    .into_iter()
    .filter(|(n, _)| *n > 0)
    .map(|(n, what)| format!("{n} {what}"))
    .collect();
    if came.repeated > 0 {
        lost.push(format!("{} came twice", count(came.repeated, "frame")));
    }
    if came.restarts > 0 {
        lost.push(format!(
            "the sensor's counter wrapped or started anew {}: what was lost about that moment is not counted",
            count(came.restarts, "time")
        ));
    }
    lost.extend(came.ended.clone());
    lost
}

/// What is shown while it runs.
struct View {
    json: bool,
    bar: ProgressBar,
    began: Instant,
    said: Vec<String>,
    spoke: Instant,
    warned: bool,
    /// Profiles at an earlier look, for the rate.
    look: (Instant, u64),
    rate_hz: f64,
}

impl View {
    fn new(json: bool) -> Self {
        let bar = if !json && std::io::stderr().is_terminal() {
            let style = ProgressStyle::with_template("{spinner} {elapsed} {msg}");
            ProgressBar::new_spinner()
                .with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
        } else {
            ProgressBar::hidden()
        };
        let now = Instant::now();
        Self {
            json,
            bar,
            began: now,
            said: Vec::new(),
            spoke: now,
            warned: false,
            look: (now, 0),
            rate_hz: 0.0,
        }
    }

    fn turn(&mut self, came: &SensorCame, latches: u64, tally: &LatchTally) -> Result<(), Failure> {
        let lost = losses(came, tally);
        let may_say = self.said.is_empty() || self.spoke.elapsed() > PAUSE;
        if lost != self.said && may_say {
            self.say("loss", &lost.join(", "))?;
            self.said = lost;
            self.spoke = Instant::now();
        }
        if came.profiles == 0 && !self.warned && self.began.elapsed() > SILENCE {
            self.warned = true;
            self.say(
                "silence",
                if latches > 0 {
                    "latches come, but no profile: is the sensor started, and set to its trigger input?"
                } else {
                    "neither latches nor profiles come: does the axis that triggers move, or the sensor?"
                },
            )?;
        }
        let (since, profiles) = self.look;
        let passed = since.elapsed().as_secs_f64();
        if passed > 0.5 {
            self.rate_hz = came.profiles.saturating_sub(profiles) as f64 / passed;
            self.look = (Instant::now(), came.profiles);
        }
        self.bar.set_message(format!(
            "{} ({:.0}/s), {}  {}",
            count(came.profiles, "profile"),
            self.rate_hz,
            latches_in_words(latches),
            came.view
        ));
        self.bar.tick();
        Ok(())
    }

    fn say(&self, kind: &str, text: &str) -> Result<(), Failure> {
        if text.is_empty() {
            return Ok(());
        }
        if self.json {
            return print_json(&json!({ "type": kind, "message": Value::from(text) }));
        }
        self.bar
            .suspend(|| print_error(&format!("{}\n", paint(BAD, text))));
        Ok(())
    }
}
