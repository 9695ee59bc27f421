//! Programs for Sinumerik and plain language against the path's file, by a reader of their own: axis words, modes, feeds,
//! order, ends, laser, for both ways of saying a path.

#[path = "plan_programs/reader.rs"]
mod reader;

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

use reader::{Motion, heidenhain, siemens};
use umi_scan::plan::mesh::{PartMesh, read_part};
use umi_scan::plan::planner::result::{ScanPlan, csv};
use umi_scan::plan::planner::{PlanOptions, plan};
use umi_scan::plan::program::{PathDialect, ProgramMode, ProgramStyle, program};
use umi_scan::plan::proof::row::PathRow;
use umi_scan::plan::spec::ScanSpec;

/// Words have three decimals, so that they are off by half of the last one.
const WORD: f64 = 0.000_501;
/// Of the same point on the part, by each of X, Y, Z.
const FEED_MM_PER_MIN: f64 = 600.0;
/// Speeds that a program's times are reckoned with.
const RAPID_MM_PER_S: f64 = 100.0;
const TURN_DEG_PER_S: f64 = 30.0;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scan-plan")
}

fn spec_text() -> String {
    std::fs::read_to_string(folder().join("spec.toml")).unwrap()
}

fn planned() -> &'static (PartMesh, ScanPlan) {
    static PLANNED: OnceLock<(PartMesh, ScanPlan)> = OnceLock::new();
    PLANNED.get_or_init(|| {
        let part = read_part(&folder().join("blade.obj")).unwrap();
        let spec = ScanSpec::read(&spec_text(), Path::new("")).unwrap();
        let options = PlanOptions {
            allow_partial: false,
            time_limit: Duration::from_secs(120),
            feed_mm_per_min: FEED_MM_PER_MIN,
        };
        let plan = plan(&part, &[], &spec, options).unwrap();
        (part, plan)
    })
}

/// So near to the proved way the point goes that a control carries, and the rounding of its words.
const APART_MM: f64 = 0.02 + 2.0 * WORD;

/// A row of the path's file, or of the way between two of them.
#[derive(Clone)]
struct Row {
    pass: i32,
    lit: bool,
    point: [f64; 3],
    axes: Vec<f64>,
}

/// The file as text is read, not what it was written from.
fn rows(text: &str, reference_mm: f64) -> (Vec<String>, Vec<Row>) {
    let mut lines = text.lines();
    let names: Vec<String> = lines
        .next()
        .unwrap()
        .split(',')
        .map(str::to_owned)
        .collect();
    assert_eq!(&names[11..14], ["X", "Y", "Z"]);
    let row = |line: &str| {
        let v: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        Row {
            pass: v[0] as i32,
            lit: v[1] == 1.0,
            point: [0, 1, 2].map(|k| v[2 + k] + reference_mm * v[5 + k]),
            axes: v[11..].to_vec(),
        }
    };
    (names[11..].to_vec(), lines.map(row).collect())
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    let squares = a.iter().zip(b).map(|(x, y)| (x - y).powi(2));
    squares.sum::<f64>().sqrt()
}

fn turned(a: &[f64], b: &[f64]) -> f64 {
    let turns = a[3..].iter().zip(&b[3..]).map(|(x, y)| (x - y).abs());
    turns.fold(0.0, f64::max)
}

/// What a program is held against.
struct Wanted {
    /// The words of X, Y, Z and the rotary axes.
    words: Vec<String>,
    rows: Vec<Row>,
    spec: ScanSpec,
    top_mm: f64,
    carried: bool,
}

impl Wanted {
    fn judge(&self, motions: &[Motion]) -> Result<(), String> {
        let [first, approach_and_rows @ .., last] = motions else {
            return Err("no motions".into());
        };
        for end in [first, last] {
            let up = end.words.len() == 1 && end.words.get("Z") == Some(&self.top_mm);
            if !up || !end.rapid || !end.of_machine || end.carried || end.lit {
                return Err(format!("no way to the top: {end:?}"));
            }
        }
        let begins = approach_and_rows
            .iter()
            .position(|m| !m.rapid)
            .ok_or("no row")?;
        let (approach, driven) = approach_and_rows.split_at(begins);
        self.approach(approach)?;
        let rows = self.with_rows_between(driven)?;
        if driven.len() != rows.len() {
            return Err(format!("{} of {} rows", driven.len(), rows.len()));
        }
        for (k, motion) in driven.iter().enumerate() {
            self.row(&rows, k, motion)
                .map_err(|why| format!("row {k}, {why}: {motion:?}"))?;
        }
        Ok(())
    }

    /// At the top over the first row with all turns done, then down, not as far as the row.
    fn approach(&self, motions: &[Motion]) -> Result<(), String> {
        let first = &self.rows[0];
        let (mut at, mut over) = (first.axes.clone(), [false; 2]);
        at[2] = self.top_mm;
        let [turns_and_over @ .., down] = motions else {
            return Err("no way down".into());
        };
        let mut named = Vec::new();
        for motion in turns_and_over {
            if motion.lit || motion.carried || motion.words.contains_key("Z") {
                return Err(format!("on the way over the row: {motion:?}"));
            }
            for (word, value) in &motion.words {
                let k = self.words.iter().position(|w| w == word);
                let k = k.ok_or(format!("{word} is no axis"))?;
                if (value - first.axes[k]).abs() > WORD
                    || motion.of_machine != (self.carried && k < 2)
                {
                    return Err(format!("not over the row: {motion:?}"));
                }
                if k < 2 {
                    over[k] = true;
                }
                named.push(k);
            }
        }
        named.sort_unstable();
        let all: Vec<usize> = (0..self.words.len()).filter(|k| *k != 2).collect();
        if named != all || over != [true; 2] || down.lit || down.of_machine {
            return Err(format!("axes before the way down: {named:?}"));
        }
        let xyz = |name: &str| down.words.get(name).copied();
        if self.carried {
            let (Some(x), Some(y), Some(z), true) = (xyz("X"), xyz("Y"), xyz("Z"), down.carried)
            else {
                return Err(format!("the way down: {down:?}"));
            };
            let above = apart(&[x, y, z], &first.point);
            if (above - 5.0).abs() > 0.002 {
                return Err(format!("{above} mm from the first row's point"));
            }
        } else {
            let z = xyz("Z").filter(|_| down.words.len() == 1);
            if z.is_none_or(|z| (z - first.axes[2] - 5.0).abs() > WORD) {
                return Err(format!("the way down: {down:?}"));
            }
        }
        Ok(())
    }

    /// The rows, and where a control carries the point those of the proved way that stand between: half way, a quarter
    /// and so on, by what the rotary words say.
    fn with_rows_between(&self, driven: &[Motion]) -> Result<Vec<Row>, String> {
        if !self.carried {
            return Ok(self.rows.clone());
        }
        let mut all: Vec<Row> = Vec::new();
        let (mut next, mut share) = (0, 0.0);
        for motion in driven {
            let row = self.rows.get(next).ok_or("more rows than there are")?;
            let turns: Option<Vec<f64>> = (self.words[3..].iter())
                .map(|word| motion.words.get(word).copied())
                .collect();
            let turns = turns.ok_or("no rotary words")?;
            let off = turns.iter().zip(&row.axes[3..]).map(|(x, y)| (x - y).abs());
            if off.fold(0.0, f64::max) <= WORD {
                all.push(row.clone());
                (next, share) = (next + 1, 0.0);
                continue;
            }
            let before = next.checked_sub(1).map(|k| &self.rows[k]);
            let before = before.ok_or("the first row is another")?;
            let widest = (3..row.axes.len()).max_by(|i, j| {
                let wide = |k: usize| (row.axes[k] - before.axes[k]).abs();
                wide(*i).total_cmp(&wide(*j))
            });
            let k = widest.ok_or("no rotary axis")?;
            let at = (turns[k - 3] - before.axes[k]) / (row.axes[k] - before.axes[k]);
            let at = (at * 1024.0).round() / 1024.0;
            if at <= share || at >= 1.0 {
                return Err(format!("a row at {at} of the way to row {next}"));
            }
            share = at;
            let scans = before.lit && row.lit && before.pass == row.pass;
            let pass = if scans { row.pass } else { -1 };
            all.push(self.on_the_way(before, row, at, pass, scans));
        }
        for (a, b) in all.iter().zip(&all[1..]) {
            let middle = self.on_the_way(a, b, 0.5, 0, false);
            let chord = [0, 1, 2].map(|k| (a.point[k] + b.point[k]) / 2.0);
            let off = apart(&middle.point, &chord);
            if off > APART_MM {
                return Err(format!("{off} mm beside the proved way"));
            }
        }
        Ok(all)
    }

    /// Where the axes are at this share of their straight way.
    fn on_the_way(&self, a: &Row, b: &Row, share: f64, pass: i32, lit: bool) -> Row {
        let pairs = a.axes.iter().zip(&b.axes);
        let axes: Vec<f64> = pairs.map(|(x, y)| x + (y - x) * share).collect();
        let pose = self.spec.machine.forward(&axes);
        let point = pose.origin_mm + pose.beam * self.spec.sensor.reference_mm;
        Row {
            pass,
            lit,
            point: point.into(),
            axes,
        }
    }

    fn row(&self, rows: &[Row], k: usize, motion: &Motion) -> Result<(), String> {
        let row = &rows[k];
        if motion.rapid || motion.of_machine || motion.carried != self.carried {
            return Err("its modes".into());
        }
        if motion.words.len() != self.words.len() {
            return Err("its words".into());
        }
        for (place, word) in self.words.iter().enumerate() {
            let wanted = if self.carried && place < 3 {
                row.point[place]
            } else {
                row.axes[place]
            };
            let found = *motion.words.get(word).ok_or(format!("no {word}"))?;
            if (found - wanted).abs() > WORD {
                return Err(format!("{word} is {wanted}"));
            }
        }
        // Before the first row: 5 mm above it.
        let before = k.checked_sub(1).map(|b| &rows[b]);
        let scanning = before.is_some_and(|b| b.lit && row.lit && b.pass == row.pass);
        if motion.lit != scanning {
            return Err("the laser".into());
        }
        let (linear, turn, way) = before.map_or((5.0, 0.0, 5.0), |b| {
            (
                apart(&b.axes[..3], &row.axes[..3]),
                turned(&b.axes, &row.axes),
                apart(&b.point, &row.point),
            )
        });
        let mut wanted_s = (linear / RAPID_MM_PER_S).max(turn / TURN_DEG_PER_S);
        if scanning || before.is_none() {
            wanted_s = wanted_s.max(way / FEED_MM_PER_MIN * 60.0);
        }
        let (found_s, rounding) = match (motion.seconds, motion.feed) {
            (Some(seconds), None) => (seconds, 1e-4),
            (None, Some(feed)) => {
                // Plain language: mm/min of X Y Z, or of the point that is carried; degrees where these stand still.
                let way = if self.carried { way } else { linear };
                let way = if way > 1e-3 { way } else { turn };
                (way / feed * 60.0, 0.51 / feed)
            }
            _ => return Err("no feed".into()),
        };
        if (found_s / wanted_s - 1.0).abs() > rounding + 1e-3 {
            return Err(format!("it takes {found_s} s; {wanted_s} are wanted"));
        }
        Ok(())
    }
}

/// From a program to its motions.
type Reader = fn(&str) -> Result<Vec<Motion>, String>;

/// A program, what it is held against, and its reader.
fn written(dialect: PathDialect, mode: ProgramMode, rotary: [&str; 3]) -> (String, Wanted, Reader) {
    let [a, c, w] = rotary;
    let text = spec_text()
        .replace("name = \"A\"", &format!("name = \"{a}\""))
        .replace("name = \"C\"", &format!("name = \"{c}\""))
        .replace("word = \"W\"", &format!("word = \"{w}\""));
    let spec = ScanSpec::read(&text, Path::new("")).unwrap();
    let (part, plan) = planned();
    let style = ProgramStyle {
        dialect,
        mode,
        feed_mm_per_min: FEED_MM_PER_MIN,
        number: 1234,
    };
    let text = program(&spec, vec![&part.surface], &plan.rows, style)
        .unwrap()
        .text;
    let (names, rows) = rows(&csv(&spec.machine, &plan.rows), 60.0);
    assert_eq!(names, ["X", "Y", "Z", a, c, "S"]);
    assert!(rows.iter().any(|r| r.pass == 2) && rows.len() > 50);
    let wanted = Wanted {
        words: ["X", "Y", "Z", a, c, w].map(str::to_owned).into(),
        rows,
        spec,
        top_mm: 400.0,
        carried: mode == ProgramMode::Rtcp,
    };
    let reader = if dialect == PathDialect::Siemens {
        siemens
    } else {
        heidenhain
    };
    (text, wanted, reader)
}

const MODES: [ProgramMode; 2] = [ProgramMode::Rotary, ProgramMode::Rtcp];

#[test]
fn every_row_comes_in_order_within_half_of_the_last_decimal() {
    for mode in MODES {
        for (dialect, rotary) in [
            (PathDialect::Siemens, ["A", "C", "W"]),
            (PathDialect::Siemens, ["A1", "C12", "W3"]),
            (PathDialect::Heidenhain, ["A", "C", "W"]),
        ] {
            let (text, wanted, reader) = written(dialect, mode, rotary);
            let motions = reader(&text).unwrap_or_else(|e| panic!("{dialect:?} {mode:?}: {e}"));
            wanted
                .judge(&motions)
                .unwrap_or_else(|e| panic!("{dialect:?} {mode:?}: {e}"));
        }
    }
}

#[test]
fn the_head_names_the_rotary_words_that_there_are() {
    let text = spec_text();
    let linear = text.split("[[machine.table]]").next().unwrap();
    let standing: String = linear
        .lines()
        .filter(|line| !line.starts_with("spindle"))
        .map(|line| format!("{line}\n"))
        .collect();
    for (text, axes, wanted) in [
        (text.as_str(), 6, "A, C, W TURNS THE SPINDLE"),
        (linear, 4, "W TURNS THE SPINDLE"),
        (&standing, 3, "NONE"),
    ] {
        let spec = ScanSpec::read(text, Path::new("")).unwrap();
        let axes = vec![10.0; axes];
        let row = PathRow {
            pass: 0,
            laser: true,
            pose: spec.machine.forward(&axes),
            axes,
        };
        let style = ProgramStyle {
            dialect: PathDialect::Siemens,
            mode: ProgramMode::Rotary,
            feed_mm_per_min: FEED_MM_PER_MIN,
            number: 1,
        };
        let program = program(&spec, Vec::new(), &[row], style).unwrap().text;
        assert!(
            program.contains(&format!("; ROTARY WORDS: {wanted}\n")),
            "{program}"
        );
    }
}

/// The judge sees what would drive elsewhere, otherwise or with the laser on.
#[test]
fn a_program_that_says_something_else_is_found_out() {
    for mode in MODES {
        for dialect in [PathDialect::Siemens, PathDialect::Heidenhain] {
            let (text, wanted, reader) = written(dialect, mode, ["A", "C", "W"]);
            let lines: Vec<&str> = text.lines().collect();
            let row = |line: &&str| {
                line.starts_with("G1 ")
                    || line.starts_with("L X") && line.contains("R0 F") && !line.contains("FMAX")
            };
            let at: Vec<usize> = (0..lines.len()).filter(|k| row(&lines[*k])).collect();
            let (middle, next) = (at[at.len() / 2], at[at.len() / 2 + 1]);
            let mut wrong: Vec<(&str, Vec<String>)> = Vec::new();
            let mut with = |what, change: &dyn Fn(&mut Vec<String>)| {
                let mut other: Vec<String> = lines.iter().map(|l| (*l).to_owned()).collect();
                change(&mut other);
                assert_ne!(other, lines, "{what}");
                wrong.push((what, other));
            };
            for (word, by) in [(" Y", 0.002), (" C", -0.002), (" W", 180.0)] {
                with("a word", &|l| l[middle] = shifted(&l[middle], word, by));
            }
            with("two rows", &|l| l.swap(middle, next));
            with("a row less", &|l| drop(l.remove(middle)));
            with("a row twice", &|l| l.insert(middle, l[middle].clone()));
            with("a feed", &|l| {
                let feed = l[middle].rfind('F').unwrap();
                l[middle].insert(feed + 1, '1');
            });
            for mark in ["LASER ON", "LINK: LASER OFF", "END: LASER OFF"] {
                with(mark, &|l| l.retain(|line| !line.contains(mark)));
            }
            let safety = if dialect == PathDialect::Siemens {
                "SUPA G0 Z"
            } else {
                "M91"
            };
            with("the first way to the top", &|l| {
                let first = l.iter().position(|line| line.contains(safety)).unwrap();
                l.remove(first);
            });
            with("the last way to the top", &|l| {
                let last = l.iter().rposition(|line| line.contains(safety)).unwrap();
                l[last] = l[last].replace("SUPA ", "").replace(" M91", "");
            });
            with("the end", &|l| l.retain(|line| line != "M30"));
            let needed: &[&str] = match (dialect, mode) {
                (PathDialect::Siemens, ProgramMode::Rotary) => &["G71", "G90", "G54", "G93"],
                (PathDialect::Siemens, ProgramMode::Rtcp) => &["D1", "TRAORI", "TRAFOOF"],
                (_, ProgramMode::Rotary) => &[" MM"],
                (_, ProgramMode::Rtcp) => &["M128", "M129"],
            };
            for word in needed {
                with(word, &|l| {
                    for line in l.iter_mut().filter(|line| !line.starts_with(';')) {
                        *line = line.replace(word, "");
                    }
                });
            }
            for (what, other) in wrong {
                let judged = reader(&(other.join("\n") + "\n")).and_then(|m| wanted.judge(&m));
                assert!(judged.is_err(), "{dialect:?} {mode:?}: {what}");
            }
        }
    }
}

/// A block with one word's value changed.
fn shifted(line: &str, word: &str, by: f64) -> String {
    let from = line.find(word).unwrap() + word.len();
    let to = line[from..].find(' ').map_or(line.len(), |k| from + k);
    let value: f64 = line[from..to].parse::<f64>().unwrap() + by;
    let sign = if line[from..].starts_with(['+', '-']) {
        format!("{value:+.3}")
    } else {
        format!("{value:.3}")
    };
    format!("{}{sign}{}", &line[..from], &line[to..])
}
