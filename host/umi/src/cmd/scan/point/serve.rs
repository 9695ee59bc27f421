//! `umi scan serve`

use std::io::{BufRead as _, IsTerminal as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use serde::Deserialize;
use serde_json::{Value, json};
use umi_client::board::link::{Client, SensorTaken};
use umi_client::journal::{PullRequest, PullStep, pull, record};
use umi_core::point::station::{CommandAnswer, check_value};
use umi_core::units::Mm;
use umi_protocol::latch::TriggerPulse;
use umi_protocol::message::Record;
use umi_protocol::point_sensor::{
    CapturedAt, PlaceReport, PlaceState, SensorOnBoard, SensorText, StationAnswer,
};
use umi_scan::point_sensor::calibration::{self, KnownSensor, OTHER_LENS_PART};

use crate::cmd::scan::answer::failure;
use crate::cmd::{Board, Format};
use crate::failure::Failure;
use crate::output::Force;
use crate::show::sensor::{loss_json, loss_text, place_json, place_text};
use crate::show::terminal::{CAUTION, paint, print, print_json};

/// Passes the lines of a digitizing program on to a board with a distance sensor
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Serve {
    #[command(flatten)]
    board: Board,
    /// The sensor as it is wired to the board, with --calibration; without both, as it was set up last
    #[arg(long, value_name = "SENSOR.toml", requires = "calibration")]
    sensor: Option<PathBuf>,
    /// What umi scan calibrate point --json has printed
    #[arg(long, value_name = "CAL.json", requires = "sensor")]
    calibration: Option<PathBuf>,
    /// Take the sensor away from the board, and do nothing else
    #[arg(long, conflicts_with_all = ["sensor", "calibration", "output"])]
    off: bool,
    /// Where the measured places go, as they come
    #[arg(short, long, value_name = "CLOUD.csv")]
    output: Option<PathBuf>,
    /// How long the captures of one line may take
    #[arg(long, value_name = "SECONDS", default_value_t = 60,
          value_parser = clap::value_parser!(u64).range(1..=3600))]
    patience: u64,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Lines come on standard input, one command each: the letters of the macro's lines (K 1 configure
with A captures a second, B power, D captures at a place, E target in mm, F 1 to guard, H step
in mm; 2 measure to adapt; 3 measure; 4 finish; 5 trip at the target; 6 trip beyond it; 7 pulses
on, 8 off). Number and check value are added where a line has none. Each line is answered by
one line: its number, the state, the distance; with --json also the values of #501 to #504 as
the macro O8842 tests them, for a program that writes a control's variables. The points are
made and journaled on the board.

SENSOR.toml:
  counts_per_mm = [1000, 1000, 1000]   # encoder counts, negative where they count down
  origin_counts = [0, 0, 0]            # where the axes' coordinates are zero
  max_rate_hz = 9000
  power_max = 5000
  baud = 921600                        # 8 data bits, no parity
  captured_at = \"pulse\"                # or \"sync\": the sensor answers at the trigger input
  text = { separator = \"blank\", number = 0, gamma = 1, snr = 2, total = 3 }   # columns
  stand_off_mm = 44                    # the middle of the lens' depth of field, and its length,
  range_mm = 8                         # both or neither: a calibration of another lens is refused

A calibration that warns of the axes' scale is refused (warm_scale), and so is one that was made at other
readings than the lens has, or than a line's target E (other_lens), before the board hears of either: what is
piped in is looked at first. Without --calibration nothing is known of that.

Examples:
  umi scan serve --sensor sensor.toml --calibration cal.json -o cloud.csv
  printf 'K1 A2000 B2000 D400 E44 F0 H1\\nK2\\n' | umi scan serve --json
  umi scan serve --off

Exit status: 0 every line was answered, 1 usage, file or connection, 2 a line (state refused: the others
are passed on all the same), a calibration or a sensor was refused, or an answer did not come.";

/// A sensor's file: what the calibration does not know.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WiredSensor {
    counts_per_mm: [f64; 3],
    origin_counts: [i64; 3],
    max_rate_hz: f64,
    power_max: f64,
    baud: u32,
    #[serde(default)]
    text: SensorText,
    #[serde(default)]
    captured_at: CapturedAt,
    #[serde(default)]
    pulse: TriggerPulse,
    /// The middle of the depth of field, and its length.
    stand_off_mm: Option<f64>,
    range_mm: Option<f64>,
}

/// Looks at the board this often while it captures.
const LOOK: Duration = Duration::from_millis(5);

impl Serve {
    pub fn run(self) -> Result<(), Failure> {
        let known = match &self.calibration {
            Some(path) => Some(calibration::read(path).map_err(failure)?),
            None => None,
        };
        if let Some(known) = &known {
            known.check_scale().map_err(failure)?;
        }
        let wanted = self.wanted(known.as_ref())?;
        if let Some(output) = &self.output {
            let inputs: Vec<&Path> = [&self.sensor, &self.calibration]
                .into_iter()
                .filter_map(|path| path.as_deref())
                .collect();
            self.force.check(output, &inputs)?;
        }
        let mut board = self.board.connect()?;
        // A board keeps its sensor: one of another lens would outlive this command. A terminal has no line yet.
        let mut ahead = None;
        if wanted.is_some() && !std::io::stdin().is_terminal() {
            ahead = std::io::stdin().lock().lines().next();
            if let Some(Ok(line)) = &ahead {
                of_this_lens(known.as_ref(), line)?;
            }
        }
        if self.off || wanted.is_some() {
            taken(board.set_sensor(wanted)?)?;
        }
        if self.off {
            return self.say("sensor taken away", &json!({"type": "sensor_off"}));
        }
        let Some(status) = board.sensor()? else {
            return Err(not_there());
        };
        if status.sensor.is_none() {
            let why = match status.setup_lost {
                Some(why) => why.to_string(),
                None => "no sensor is set up on this board".to_owned(),
            };
            return Err(Failure::refused(
                "no_sensor",
                format_args!("{why}: give --sensor and --calibration"),
            ));
        }
        let mut cloud = match &self.output {
            Some(path) => Some(Cloud::create(path)?),
            None => None,
        };
        let mut next_seq = board.journal_info()?.next_seq;
        let mut sequence = status.answer.map_or(0, |answer| answer.sequence);
        let mut refused = false;
        for line in ahead.into_iter().chain(std::io::stdin().lock().lines()) {
            let line = line.map_err(|error| Failure::trouble("input", error))?;
            if line.trim().is_empty() {
                continue;
            }
            sequence = sequence % 9999 + 1;
            of_this_lens(known.as_ref(), &line)?;
            let (number, text) = checked(&line, sequence)?;
            sequence = number;
            let text = text.bytes().collect();
            taken(board.sensor_command(text)?)?;
            let answer = self.answer(&mut board, number)?;
            self.tell(&answer)?;
            next_seq = self.collect(&mut board, next_seq, cloud.as_mut())?;
            refused |= answer.state == PlaceState::Refused;
        }
        match refused {
            // Its answer has told it.
            true => Err(Failure::Negative),
            false => Ok(()),
        }
    }

    /// The sensor that is asked for.
    fn wanted(&self, known: Option<&KnownSensor>) -> Result<Option<SensorOnBoard>, Failure> {
        let (Some(sensor), Some(known)) = (&self.sensor, known) else {
            return Ok(None);
        };
        let text = std::fs::read_to_string(sensor)
            .map_err(|error| Failure::file("read", sensor, &error))?;
        let wired: WiredSensor = toml::from_str(&text).map_err(|error| {
            Failure::trouble("bad_sensor", format_args!("{}: {error}", sensor.display()))
        })?;
        match (wired.stand_off_mm, wired.range_mm) {
            (Some(stand_off_mm), Some(range_mm)) => {
                let said = format_args!(
                    "{} says {range_mm} mm about {stand_off_mm} mm",
                    sensor.display()
                );
                known
                    .check_stand_off(stand_off_mm, range_mm / 2.0, said)
                    .map_err(failure)?;
            }
            (None, None) => {}
            _ => {
                return Err(Failure::trouble(
                    "bad_sensor",
                    format_args!(
                        "{}: stand_off_mm and range_mm belong together: give both, or neither",
                        sensor.display()
                    ),
                ));
            }
        }
        Ok(Some(SensorOnBoard {
            offset_mm: known.sensor.offset.to_array_mm(),
            direction: known.sensor.direction.into(),
            gain: known.sensor.gain,
            counts_per_mm: wired.counts_per_mm,
            origin_counts: wired.origin_counts,
            max_rate_hz: wired.max_rate_hz,
            power_max: wired.power_max,
            baud: wired.baud,
            text: wired.text,
            captured_at: wired.captured_at,
            pulse: wired.pulse,
        }))
    }

    /// Waits for the answer to a line.
    fn answer(&self, board: &mut Client, number: u16) -> Result<StationAnswer, Failure> {
        let deadline = Instant::now() + Duration::from_secs(self.patience);
        loop {
            let status = board.sensor()?.ok_or_else(not_there)?;
            if let Some(answer) = status.answer.filter(|of| of.sequence == number) {
                return Ok(answer);
            }
            if !status.waits {
                return Err(Failure::refused(
                    "not_a_command",
                    format_args!(
                        "line {number} is no command of the station: letters K, A, B, D, E, F, H with numbers, at most 4 digits in S"
                    ),
                ));
            }
            if Instant::now() > deadline {
                return Err(Failure::refused(
                    "no_answer",
                    format_args!(
                        "the captures of line {number} are not over after {} s: look at the sensor, or give a longer --patience",
                        self.patience
                    ),
                ));
            }
            std::thread::sleep(LOOK);
        }
    }

    fn tell(&self, answer: &StationAnswer) -> Result<(), Failure> {
        let state = answer.state.code();
        let text = format!("{} {state} {:.4}", answer.sequence, answer.gamma_mm);
        self.say(
            &text,
            &json!({
                "type": "answer",
                "sequence": answer.sequence,
                "state": state,
                "gamma_mm": answer.gamma_mm,
                "variables": variables(answer),
            }),
        )
    }

    /// Tells and keeps the places that the board has journaled since an entry; the entry after them.
    fn collect(
        &self,
        board: &mut Client,
        from: u64,
        mut cloud: Option<&mut Cloud>,
    ) -> Result<u64, Failure> {
        if board.journal_info()?.next_seq <= from {
            return Ok(from);
        }
        let mut next = from;
        let request = PullRequest {
            from: Some(from),
            ..PullRequest::default()
        };
        pull(board, request, |step| {
            let PullStep::Entry(entry, _) = step else {
                return Ok::<_, Failure>(());
            };
            next = entry.seq + 1;
            match record(&entry) {
                Ok(Record::Place(place)) => {
                    if let Some(cloud) = cloud.as_mut() {
                        cloud.add(&place)?;
                    }
                    self.say(&place_text(&place), &place_json(&place))
                }
                Ok(Record::CaptureLost(loss)) => {
                    self.say(&paint(CAUTION, loss_text(&loss)), &loss_json(&loss))
                }
                _ => Ok(()),
            }
        })?;
        Ok(next)
    }

    fn say(&self, text: &str, value: &Value) -> Result<(), Failure> {
        match self.format.json {
            true => print_json(value),
            false => print(&format!("{text}\n")),
        }
    }
}

/// What the board makes of a sensor or a line, as a failure if it is not taken.
fn taken(taken: SensorTaken) -> Result<(), Failure> {
    match taken {
        SensorTaken::Done => Ok(()),
        SensorTaken::Refused(why) => Err(Failure::refused(why.code(), why)),
        SensorTaken::NotOnThisBoard => Err(not_there()),
    }
}

fn not_there() -> Failure {
    Failure::refused(
        "not_on_this_board",
        "this board has no port for a distance sensor: see its README",
    )
}

/// The variables that a served control gets, by their numbers.
fn variables(answer: &StationAnswer) -> Value {
    let program = CommandAnswer {
        gamma: Mm(answer.gamma_mm),
        state: answer.state,
        sequence: answer.sequence,
    }
    .program();
    let values = program.lines().filter_map(|line| {
        let (variable, value) = line.strip_prefix('#')?.split_once('=')?;
        Some((variable.to_owned(), json!(value.parse::<f64>().ok()?)))
    });
    Value::Object(values.collect())
}

/// Refuses a line that configures a target which this calibration's lens does not have.
fn of_this_lens(known: Option<&KnownSensor>, line: &str) -> Result<(), Failure> {
    // What is no command is told where it is passed on.
    let (Some(known), Ok(words)) = (known, words(&line.trim().to_ascii_uppercase())) else {
        return Ok(());
    };
    let of = |wanted: char| words.iter().find(|(letter, _)| *letter == wanted);
    let (Some((_, 1.0)), Some((_, target_mm)), Some(stand_off_mm)) =
        (of('K'), of('E'), known.stand_off_mm)
    else {
        return Ok(());
    };
    let within_mm = OTHER_LENS_PART * stand_off_mm.abs();
    let said = format_args!("the line's target is E {target_mm} mm");
    known
        .check_stand_off(*target_mm, within_mm, said)
        .map_err(failure)
}

/// The letters of a line with their numbers.
fn words(line: &str) -> Result<Vec<(char, f64)>, &'static str> {
    let rest = line.strip_prefix("UMIP").unwrap_or(line);
    let mut words = Vec::new();
    for word in rest.split_inclusive(|c: char| c.is_ascii_digit() || c == '.' || c == '-') {
        // A word goes on as long as figures come.
        let begins = word
            .trim_start()
            .starts_with(|c: char| c.is_ascii_alphabetic());
        match (begins, words.last_mut()) {
            (true, _) => words.push(word.to_owned()),
            (false, Some(last)) => *last += word,
            (false, None) => return Err("it begins with no letter"),
        }
    }
    let mut values: Vec<(char, f64)> = Vec::new();
    for word in &words {
        let word = word.trim();
        let mut letters = word.chars();
        let letter = letters.next().unwrap_or(' ');
        let value = letters.as_str().trim().replace(' ', "");
        let value: f64 = value.parse().map_err(|_| "a letter has no number")?;
        values.push((letter, value));
    }
    Ok(values)
}

/// A line with its number and check value: as it came where it has them, with this number where not.
fn checked(line: &str, sequence: u16) -> Result<(u16, String), Failure> {
    let line = line.trim().to_ascii_uppercase();
    let bad = |why: &str| {
        Failure::refused(
            "not_a_command",
            format_args!("`{line}`: {why}; write a line as K1 A2000 B2000 D400 E44 F0 H1, or K3"),
        )
    };
    let values = words(&line).map_err(bad)?;
    let of = |wanted: char| values.iter().find(|(letter, _)| *letter == wanted);
    if let (Some((_, number)), Some(_)) = (of('S'), of('C')) {
        // Whole as it is: the board holds its check value.
        return Ok((*number as u16, line));
    }
    if of('K').is_none() {
        return Err(bad("it has no command K"));
    }
    let mut text = format!("UMIP S{sequence}");
    let mut all = vec![i64::from(sequence) * 1000];
    for letter in ['K', 'A', 'B', 'D', 'E', 'F', 'H'] {
        if let Some((_, value)) = of(letter) {
            text += &format!(" {letter}{value:.3}");
            all.push((value * 1000.0).round() as i64);
        }
    }
    if values
        .iter()
        .any(|(letter, _)| !"SKABDEFH".contains(*letter))
    {
        return Err(bad("it has a letter that no command has"));
    }
    text += &format!(" C{}", check_value(&all));
    Ok((sequence, text))
}

/// Places as they come.
struct Cloud {
    path: PathBuf,
    file: std::fs::File,
}

impl Cloud {
    fn create(path: &Path) -> Result<Self, Failure> {
        let file =
            std::fs::File::create(path).map_err(|error| Failure::file("write", path, &error))?;
        let mut cloud = Self {
            path: path.to_owned(),
            file,
        };
        cloud.write(
            "number,x_mm,y_mm,z_mm,gamma_mm,qx_mm,qy_mm,qz_mm,snr,total,captures,status\n",
        )?;
        Ok(cloud)
    }

    fn write(&mut self, text: &str) -> Result<(), Failure> {
        use std::io::Write as _;
        self.file
            .write_all(text.as_bytes())
            .map_err(|error| Failure::file("write", &self.path, &error))
    }

    fn add(&mut self, place: &PlaceReport) -> Result<(), Failure> {
        let status = place.state.code();
        let number = place.number;
        let line = match place.point_mm {
            Some([x, y, z]) => {
                let [qx, qy, qz] = place.axes_mm;
                format!(
                    "{number},{x:.7},{y:.7},{z:.7},{:.7},{qx:.7},{qy:.7},{qz:.7},{:.1},{:.0},{},{status}\n",
                    place.gamma_mm, place.snr, place.total, place.captures
                )
            }
            None => format!("{number},,,,,,,,,,{},{status}\n", place.captures),
        };
        self.write(&line)
    }
}

#[cfg(test)]
mod tests {
    use super::checked;

    /// Short lines become those of the macro; whole ones stay; what is none is refused.
    #[test]
    fn lines_are_completed() {
        let (number, text) = checked("k1 a2000 b 2000 D400 E44.5 F0 H1", 7).unwrap();
        assert_eq!(number, 7);
        assert!(
            text.starts_with("UMIP S7 K1.000 A2000.000 B2000.000 D400.000 E44.500 F0.000 H1.000 C"),
            "{text}"
        );
        let (number, again) = checked(&text, 9).unwrap();
        assert_eq!((number, again), (7, text));
        for bad in ["", "12", "A1", "K", "K1 X2", "measure"] {
            assert!(checked(bad, 1).is_err(), "{bad}");
        }
    }
}
