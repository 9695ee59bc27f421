//! The sensor's side of a recording: its data channel into a file, group by group.

use std::fs::File;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use umi_scan::ScanError;
use umi_scan::format::profiles::groups::Groups;
use umi_scan::format::profiles::{Depth, gocator};

use crate::failure::Failure;

/// How long a sensor may take to answer.
const PATIENCE: Duration = Duration::from_secs(3);
/// How often it is looked whether to stop.
const TURN: Duration = Duration::from_millis(50);
/// What is under way at the end arrives within this time.
const LAST: Duration = Duration::from_millis(300);
/// How often the live profile is renewed.
const VIEW: Duration = Duration::from_millis(250);
/// A frame that comes again has its time within this.
const SAME_TIME_US: f64 = 1.0;
/// Columns of the live profile.
const COLUMNS: usize = 48;

/// What has come so far.
#[derive(Clone, Debug, Default)]
pub(super) struct SensorCame {
    /// Profiles, repeated ones too.
    pub profiles: u64,
    /// Frames that are missing in the sensor's counter.
    pub lost: u64,
    /// Frames that came again.
    pub repeated: u64,
    /// The profile that came last, as a line of marks.
    pub view: String,
    /// The channel ended, and why.
    pub ended: Option<String>,
    /// How often the counter wrapped or started anew; what was lost about that moment is not counted.
    pub restarts: u64,
    /// The last frame and its time.
    last: Option<(u64, f64)>,
}

/// A channel that is being recorded.
pub(super) struct SensorFile {
    came: Arc<Mutex<SensorCame>>,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

/// Reads `tcp:HOST[:PORT]`; 3196 is a Gocator's data channel.
pub(super) fn address(text: &str) -> Result<String, String> {
    let wrong = || format!("`{text}` is no sensor: give tcp:HOST or tcp:HOST:PORT");
    let place = text.strip_prefix("tcp:").ok_or_else(wrong)?;
    let place = place.trim_start_matches("//");
    match place.rsplit_once(':') {
        _ if place.is_empty() => Err(wrong()),
        None => Ok(format!("{place}:3196")),
        Some((host, port)) => {
            let port: u16 = port.parse().map_err(|_| wrong())?;
            if host.is_empty() || port == 0 {
                return Err(wrong());
            }
            Ok(format!("{host}:{port}"))
        }
    }
}

/// Connects to a sensor's data channel.
pub(super) fn connect(address: &str) -> Result<TcpStream, Failure> {
    let unreached = |error: &dyn std::fmt::Display| {
        Failure::trouble(
            "sensor",
            format_args!("no connection to the sensor at {address}: {error}"),
        )
    };
    let place = address
        .to_socket_addrs()
        .map_err(|error| unreached(&error))?
        .next()
        .ok_or_else(|| unreached(&"nobody of this name"))?;
    let stream = TcpStream::connect_timeout(&place, PATIENCE).map_err(|error| unreached(&error))?;
    stream
        .set_read_timeout(Some(TURN))
        .map_err(|error| unreached(&error))?;
    Ok(stream)
}

impl SensorFile {
    /// Writes what comes to a file that is not there yet.
    pub fn begin(stream: TcpStream, path: &Path) -> Result<Self, Failure> {
        let file = File::create_new(path).map_err(|error| Failure::file("write", path, &error))?;
        let came: Arc<Mutex<SensorCame>> = Arc::default();
        let stop = Arc::new(AtomicBool::new(false));
        let work = Work {
            stream,
            file,
            path: path.to_owned(),
            came: Arc::clone(&came),
            stop: Arc::clone(&stop),
        };
        let thread = std::thread::Builder::new()
            .name("sensor".into())
            .spawn(move || work.run())
            .map_err(|error| Failure::trouble("sensor", error))?;
        Ok(Self { came, stop, thread })
    }

    /// What has come so far.
    pub fn came(&self) -> SensorCame {
        self.came
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// Ends it, once nothing has come for a while.
    pub fn end(self) -> SensorCame {
        self.stop.store(true, Ordering::Relaxed);
        // A panic there has been printed.
        let _ = self.thread.join();
        Arc::try_unwrap(self.came)
            .map(|came| came.into_inner().unwrap_or_else(PoisonError::into_inner))
            .unwrap_or_default()
    }
}

struct Work {
    stream: TcpStream,
    file: File,
    path: PathBuf,
    came: Arc<Mutex<SensorCame>>,
    stop: Arc<AtomicBool>,
}

impl Work {
    fn run(mut self) {
        let mut groups = Groups::default();
        let mut buffer = vec![0; 1 << 16];
        let mut shown = Instant::now();
        let mut stopped: Option<Instant> = None;
        let ended = loop {
            if stopped.is_none() && self.stop.load(Ordering::Relaxed) {
                stopped = Some(Instant::now());
            }
            // A sensor with a rhythm of its own never falls silent.
            if stopped.is_some_and(|stopped| stopped.elapsed() > LAST) {
                break None;
            }
            match self.stream.read(&mut buffer) {
                Ok(0) => break Some("the sensor has closed its channel".to_owned()),
                Ok(got) => {
                    groups.push(buffer.get(..got).unwrap_or_default());
                    if let Err(error) = self.take(&mut groups, &mut shown) {
                        break Some(error.message);
                    }
                }
                Err(error)
                    if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) =>
                {
                    if stopped.is_some() {
                        break None;
                    }
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => break Some(format!("the sensor's channel: {error}")),
            }
        };
        let _ = self.file.sync_all();
        self.came
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .ended = ended;
    }

    /// Writes the groups that are whole: whatever ends this program, the file ends between two.
    fn take(&mut self, groups: &mut Groups, shown: &mut Instant) -> Result<(), ScanError> {
        while let Some(group) = groups.next_group()? {
            self.file
                .write_all(&group)
                .map_err(|error| ScanError::file("write", &self.path, &error))?;
            let view = shown.elapsed() >= VIEW;
            let depth = if view { Depth::Samples } else { Depth::Stamps };
            let mut came = self.came.lock().unwrap_or_else(PoisonError::into_inner);
            gocator::visit(group.as_slice(), "the sensor's channel", depth, |profile| {
                came.count(profile.stamp.frame, profile.stamp.t_us);
                if view {
                    came.view = line(profile.samples);
                }
                Ok(())
            })?;
            if view {
                *shown = Instant::now();
            }
        }
        Ok(())
    }
}

impl SensorCame {
    /// Counts a profile. A lower number at a later time than the last is no repetition: the counter wrapped, or started
    /// anew. What was lost about that moment nothing tells.
    fn count(&mut self, frame: u64, t_us: f64) {
        self.profiles += 1;
        match self.last {
            // From before the counter wrapped: it is later in number, and earlier in time.
            Some((_, last_us)) if t_us < last_us - SAME_TIME_US => self.repeated += 1,
            Some((last, _)) if frame > last => {
                self.lost += frame - last - 1;
                self.last = Some((frame, t_us));
            }
            Some((last, last_us)) if frame < last && t_us > last_us + SAME_TIME_US => {
                self.restarts += 1;
                self.last = Some((frame, t_us));
            }
            Some(_) => self.repeated += 1,
            None => self.last = Some((frame, t_us)),
        }
    }
}

/// A profile as a line of marks: low to high, blank without range.
fn line(samples: &[umi_scan::profile::ProfilePoint]) -> String {
    const MARKS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let ends = |of: &dyn Fn(&umi_scan::profile::ProfilePoint) -> f64| {
        samples
            .iter()
            .map(of)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), v| {
                (least.min(v), most.max(v))
            })
    };
    let (left, right) = ends(&|p| p.x_mm);
    let (low, high) = ends(&|p| p.z_mm);
    let mut heights = [None; COLUMNS];
    for sample in samples {
        let column = (sample.x_mm - left) / (right - left).max(1e-9) * (COLUMNS - 1) as f64;
        if let Some(height) = heights.get_mut(column.round() as usize) {
            *height = Some((sample.z_mm - low) / (high - low).max(1e-9));
        }
    }
    heights
        .iter()
        .map(|height| {
            let place = height.map(|height| (height * 7.0).round() as usize);
            place.and_then(|place| MARKS.get(place)).map_or(' ', |m| *m)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::SensorCame;

    /// A 16-bit counter wraps with a frame lost behind it; a frame comes again; the counter starts anew.
    #[test]
    fn losses_are_counted_within_each_run_of_the_counter() {
        let mut came = SensorCame::default();
        for (frame, t_us) in [
            (65_534, 0.0),
            (65_535, 10.0),
            (0, 20.0),
            (2, 40.0),
            (2, 40.0),
            (65_535, 10.0),
            (3, 50.0),
            (0, 60.0),
            (1, 70.0),
        ] {
            came.count(frame, t_us);
        }
        assert_eq!((came.profiles, came.restarts), (9, 2));
        assert_eq!((came.lost, came.repeated), (1, 2));
    }
}
