//! The process that emulates the board, and its bench port.

use std::io::{self, BufRead, BufReader, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use serde_json::{Value, json};
use umi_app::board::Lights;

use super::AXES;
use crate::rig::image;

/// Where the RAM begins.
const RAM: u32 = 0x2000_0000;
/// Where the image does: with the address at which its stack begins.
const VECTORS: u32 = 0x1000_0100;
/// What stands in RAM that nothing has been written to.
const UNTOUCHED: u32 = 0xA5A5_A5A5;

/// Whether the board's time goes on by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// At most as fast as real time.
    Free,
    /// Only when [`Emulator::run`] says so: every run of a test is the same, to the cycle.
    Paused,
}

/// A part of an axis' motion.
#[derive(Clone, Copy, Debug)]
pub enum Segment {
    /// So many edges, up or down, with constant acceleration.
    Move {
        /// Number of edges: counts.
        edges: u64,
        /// Cycles per edge at the begin.
        from: f64,
        /// Cycles per edge at the end.
        to: f64,
        /// Whether it counts up.
        up: bool,
    },
    /// It stands for so many cycles.
    Rest(u64),
}

impl Segment {
    /// So many counts at a constant rate; negative: down.
    #[must_use]
    pub const fn steady(counts: i64, cycles_per_count: f64) -> Self {
        Self::Move {
            edges: counts.unsigned_abs(),
            from: cycles_per_count,
            to: cycles_per_count,
            up: counts > 0,
        }
    }

    fn json(self) -> Value {
        match self {
            Self::Move {
                edges,
                from,
                to,
                up,
            } => json!({ "edges": edges, "from": from, "to": to, "up": up }),
            Self::Rest(cycles) => json!({ "rest": cycles }),
        }
    }
}

/// Pulses on an input.
#[derive(Clone, Copy, Debug)]
pub struct EmulatedPulses {
    /// The input.
    pub pin: u8,
    /// How many.
    pub count: u64,
    /// Cycles from one to the next.
    pub period: u64,
    /// Each comes up to so many cycles later, at random.
    pub jitter: u64,
    /// How long each is, in cycles.
    pub width: u64,
    /// Cycles before the first.
    pub after: u64,
    /// Whether [`Emulator::truth`] shall tell where the axes were.
    pub is_recorded: bool,
}

impl Default for EmulatedPulses {
    fn default() -> Self {
        Self {
            pin: 0,
            count: 1,
            period: 0,
            jitter: 0,
            width: 1000,
            after: 1000,
            is_recorded: false,
        }
    }
}

/// One instant in the emulator's time and in the board's.
#[derive(Clone, Copy, Debug)]
pub struct Time {
    /// The emulator's.
    pub cycle: u64,
    /// The cycle at which the chip, and its microsecond timer, began.
    pub began: u64,
    /// What that timer says, read by its registers.
    pub timer_us: u64,
}

/// What an interrupt took, in cycles.
#[derive(Clone, Copy, Debug)]
pub struct EmulatedInterrupt {
    /// Its number.
    pub number: u64,
    /// How often it came.
    pub count: u64,
    /// The longest time from its request to its first instruction.
    pub wait_cycles: u64,
    /// The longest time from there to its return.
    pub run_cycles: u64,
    /// The longest time from a request to its return: the longest wait and the longest run are seldom of one.
    pub whole_cycles: u64,
}

/// What the world knows of an axis.
#[derive(Clone, Copy, Debug)]
pub struct EmulatedAxis {
    /// Where it is, in counts.
    pub position: i64,
    /// Edges since the board first had power.
    pub edges: u64,
    /// Transitions that no encoder makes.
    pub illegal: u64,
    /// Whether more edges will come.
    pub is_moving: bool,
}

/// Where the axes truly were at an edge of a recorded input.
#[derive(Clone, Copy, Debug)]
pub struct EmulatorTruth {
    /// The input.
    pub pin: u8,
    /// The edge.
    pub cycle: u64,
    /// Counts.
    pub positions: [i64; AXES],
    /// Cycles since each axis' last edge.
    pub since: [u64; AXES],
    /// Cycles to each axis' next edge; none if it stands.
    pub until: [Option<u64>; AXES],
}

/// A change of an output.
#[derive(Clone, Copy, Debug)]
pub struct EmulatedOutput {
    /// Which.
    pub pin: u8,
    /// To which level.
    pub level: bool,
    /// When.
    pub cycle: u64,
}

/// What the bench sees of the board.
#[derive(Clone, Debug)]
pub struct EmulatorState {
    /// Cycles since the board first had power.
    pub cycle: u64,
    /// What the core could not do, if anything.
    pub fault: Option<String>,
    /// Resets since the start.
    pub resets: usize,
    /// Outputs to the machine.
    pub lights: Lights,
    /// Output to the scanner.
    pub laser_is_on: bool,
    /// Whether the host has configured the board.
    pub is_configured: bool,
    /// Bytes for the board that the control has not sent yet.
    pub control_waiting: u64,
    /// XOFFs that the control has obeyed.
    pub control_held: u64,
    /// Characters that came to the board while it had no room for them.
    pub overruns: u64,
    /// Packets that came to the host out of turn.
    pub toggle_errors: u64,
    /// Cycles in which the core slept.
    pub slept_cycles: u64,
    /// Emulated cycles per second of the wall.
    pub cycles_per_second: u64,
    /// All of it.
    pub json: Value,
}

/// An emulated board.
pub struct Emulator {
    process: Child,
    bench: BufReader<TcpStream>,
    control: u16,
    host: u16,
}

impl Emulator {
    /// Starts one with the image of `UMI_PICO_IMAGE`, or the one that `cargo xtask
    /// firmware pico` has built.
    ///
    /// # Errors
    /// Why it does not start.
    pub fn start(how: Start) -> Result<Self, String> {
        Self::start_image(&image("UMI_PICO_IMAGE", "pico.elf")?, how)
    }

    /// Starts one with this image.
    ///
    /// # Errors
    /// Why it does not start.
    pub fn start_image(image: &Path, how: Start) -> Result<Self, String> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("rp2040");
        if !folder.join("node_modules/rp2040js").is_dir() {
            return Err("the emulator is not installed: type `npm ci` in tests/rp2040".into());
        }
        let mut command = Command::new("node");
        command.arg(folder.join("main.js")).arg(image);
        if how == Start::Paused {
            command.arg("--paused");
        }
        let mut process = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| format!("there is no `node` for the emulator: {error}"))?;
        let output = process.stdout.take().ok_or("node has no output")?;
        let mut line = String::new();
        BufReader::new(output)
            .read_line(&mut line)
            .map_err(|error| format!("the emulator says nothing: {error}"))?;
        let ports: Value = serde_json::from_str(&line)
            .map_err(|_| format!("the emulator did not start with {}", image.display()))?;
        let port = |name: &str| {
            ports[name]
                .as_u64()
                .and_then(|port| u16::try_from(port).ok())
                .ok_or_else(|| format!("the emulator names no {name} port"))
        };
        let bench = TcpStream::connect(("127.0.0.1", port("bench")?))
            .and_then(|stream| stream.set_nodelay(true).map(|()| stream))
            .map_err(|error| format!("no way to the emulator's bench: {error}"))?;
        Ok(Self {
            process,
            bench: BufReader::new(bench),
            control: port("control")?,
            host: port("host")?,
        })
    }

    /// A request of the bench protocol, and its answer.
    ///
    /// # Panics
    /// If the emulator refuses it or is gone: the test is wrong then.
    pub fn ask(&mut self, request: &Value) -> Value {
        let answer = self
            .exchange(request)
            .unwrap_or_else(|error| panic!("the emulator is gone at {request}: {error}"));
        assert!(
            answer.get("error").is_none(),
            "the emulator refuses {request}: {answer}"
        );
        answer
    }

    fn exchange(&mut self, request: &Value) -> io::Result<Value> {
        self.bench
            .get_mut()
            .write_all(format!("{request}\n").as_bytes())?;
        let mut line = String::new();
        self.bench.read_line(&mut line)?;
        Ok(serde_json::from_str(&line)?)
    }

    /// Lets so many cycles pass.
    pub fn run(&mut self, cycles: u64) -> EmulatorState {
        state(self.ask(&json!({ "do": "run", "cycles": cycles })))
    }

    /// How it is.
    pub fn state(&mut self) -> EmulatorState {
        state(self.ask(&json!({ "do": "state" })))
    }

    /// Starts an axis' motion, with options of the bench protocol's `axis`; when.
    pub fn start_axis(&mut self, axis: usize, segments: &[Segment], options: &Value) -> u64 {
        let segments: Vec<Value> = segments.iter().map(|segment| segment.json()).collect();
        let mut request = json!({ "do": "axis", "axis": axis, "segments": segments });
        if let (Some(request), Some(options)) = (request.as_object_mut(), options.as_object()) {
            request.extend(options.clone());
        }
        number(&self.ask(&request)["start"])
    }

    /// Starts pulses; the cycle of the first.
    pub fn pulses(&mut self, pulses: &EmulatedPulses) -> u64 {
        number(
            &self.ask(&json!({
                "do": "pulses",
                "pin": pulses.pin,
                "count": pulses.count,
                "period": pulses.period,
                "jitter": pulses.jitter,
                "width": pulses.width,
                "after": pulses.after,
                "record": pulses.is_recorded,
                "both": pulses.pin == super::SKIP_PIN && pulses.is_recorded,
            }))["start"],
        )
    }

    /// Pulses of a width at these cycles after the first that is free; that cycle.
    pub fn pulses_at(&mut self, pin: u8, at: &[u64], width: u64) -> u64 {
        let request =
            json!({ "do": "pulses", "pin": pin, "at": at, "width": width, "record": true });
        number(&self.ask(&request)["start"])
    }

    /// Pulses of these widths at these cycles after the first that is free; that cycle. The truth is
    /// kept at both edges of each. `active` is the level of a pulse.
    pub fn wave(&mut self, pin: u8, pulses: &[(u64, u64)], active: bool) -> u64 {
        let (at, widths): (Vec<u64>, Vec<u64>) = pulses.iter().copied().unzip();
        let request = json!({
            "do": "pulses", "pin": pin, "at": at, "widths": widths, "active": u8::from(active),
            "record": true, "both": true,
        });
        number(&self.ask(&request)["start"])
    }

    /// The time by the world's clock and by the board's.
    pub fn time(&mut self) -> Time {
        let answer = self.ask(&json!({ "do": "time" }));
        Time {
            cycle: number(&answer["cycle"]),
            began: number(&answer["began"]),
            timer_us: number(&answer["timer_us"]),
        }
    }

    /// What each interrupt took since this was asked last, at its worst.
    pub fn interrupts(&mut self) -> Vec<EmulatedInterrupt> {
        let answer = self.ask(&json!({ "do": "interrupts" }));
        let rows = answer["rows"].as_array().expect("rows");
        rows.iter()
            .map(|row| EmulatedInterrupt {
                number: number(&row[0]),
                count: number(&row[1]),
                wait_cycles: number(&row[2]),
                run_cycles: number(&row[3]),
                whole_cycles: number(&row[4]),
            })
            .collect()
    }

    /// Takes the bus away from the DMA for so long.
    pub fn hold_transfers(&mut self, cycles: u64) {
        self.ask(&json!({ "do": "dma_hold", "cycles": cycles }));
    }

    /// Where the axes are.
    pub fn axes(&mut self) -> Vec<EmulatedAxis> {
        let answer = self.ask(&json!({ "do": "axes" }));
        let axes = answer["axes"].as_array().expect("a list of axes");
        axes.iter()
            .map(|axis| EmulatedAxis {
                position: signed(&axis["position"]),
                edges: number(&axis["edges"]),
                illegal: number(&axis["illegal"]),
                is_moving: axis["isMoving"] == true,
            })
            .collect()
    }

    /// Where the axes truly were at the recorded edges since this was asked last.
    pub fn truth(&mut self) -> Vec<EmulatorTruth> {
        let answer = self.ask(&json!({ "do": "truth" }));
        let rows = answer["rows"].as_array().expect("rows");
        let width = 2 + 3 * AXES;
        rows.chunks_exact(width)
            .map(|row| {
                let of_axis = |axis: usize, what: usize| signed(&row[2 + 3 * axis + what]);
                EmulatorTruth {
                    pin: u8::try_from(number(&row[0])).expect("a pin"),
                    cycle: number(&row[1]),
                    positions: std::array::from_fn(|axis| of_axis(axis, 0)),
                    since: std::array::from_fn(|axis| of_axis(axis, 1).unsigned_abs()),
                    until: std::array::from_fn(|axis| u64::try_from(of_axis(axis, 2)).ok()),
                }
            })
            .collect()
    }

    /// Changes of outputs since this was asked last.
    pub fn outputs(&mut self) -> Vec<EmulatedOutput> {
        let answer = self.ask(&json!({ "do": "outputs" }));
        let changes = answer["changes"].as_array().expect("changes");
        changes
            .iter()
            .map(|change| EmulatedOutput {
                pin: u8::try_from(number(&change[0])).expect("a pin"),
                level: change[1] == 1,
                cycle: number(&change[2]),
            })
            .collect()
    }

    /// Words of the chip's memory.
    pub fn memory(&mut self, address: u32, words: u32) -> Vec<u32> {
        let request = json!({ "do": "memory", "address": address, "words": words });
        let answer = self.ask(&request);
        let words = answer["words"].as_array().expect("words");
        let word = |word| u32::try_from(number(word)).expect("a word");
        words.iter().map(word).collect()
    }

    /// Writes a word of the chip's memory or registers, as the core does.
    pub fn set_memory(&mut self, address: u32, value: u32) {
        self.ask(&json!({ "do": "memory_set", "address": address, "value": value }));
    }

    /// Where the stack begins: above its highest word. It ends with the memory, at `RAM`.
    pub fn stack_top(&mut self) -> u32 {
        self.memory(VECTORS, 1)[0]
    }

    /// How many bytes of the stack have been written since the power came.
    pub fn stack_bytes(&mut self) -> u32 {
        let room = self.stack_top() - RAM;
        let words = self.memory(RAM, room / 4);
        let untouched = words.iter().take_while(|word| **word == UNTOUCHED).count();
        room - 4 * u32::try_from(untouched).expect("fewer than there are")
    }

    /// Leaves so many bytes of the stack: what is on it is copied down. Not while the core
    /// works, as it has addresses of the stack in its registers: then false.
    pub fn sink_stack(&mut self, free: u32) -> bool {
        let top = self.stack_top();
        let request = json!({ "do": "sink_stack", "top": top, "bottom": RAM, "free": free });
        self.ask(&request)["done"] == true
    }

    /// Takes the power away or gives it.
    pub fn power(&mut self, on: bool) {
        self.ask(&json!({ "do": "power", "on": on }));
    }

    /// The control's end of its line.
    ///
    /// # Errors
    /// The system's.
    pub fn control(&self) -> io::Result<TcpStream> {
        connect(self.control)
    }

    /// The host's program's end of the USB port: open as long as this is.
    ///
    /// # Errors
    /// The system's.
    pub fn host(&self) -> io::Result<TcpStream> {
        connect(self.host)
    }

    /// The same, as an address for `umi --port`.
    #[must_use]
    pub fn host_address(&self) -> String {
        format!("tcp://127.0.0.1:{}", self.host)
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        // It ends when its input does; what is left of it is taken away.
        drop(self.process.stdin.take());
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn connect(port: u16) -> io::Result<TcpStream> {
    let stream = TcpStream::connect(("127.0.0.1", port))?;
    stream.set_nodelay(true)?;
    Ok(stream)
}

fn number(value: &Value) -> u64 {
    value
        .as_u64()
        .unwrap_or_else(|| panic!("{value} is no count"))
}

fn signed(value: &Value) -> i64 {
    value
        .as_i64()
        .unwrap_or_else(|| panic!("{value} is no number"))
}

fn state(json: Value) -> EmulatorState {
    let outputs = &json["outputs"];
    let is = |name: &str| outputs[name] == true;
    EmulatorState {
        cycle: number(&json["cycle"]),
        fault: json["fault"].as_str().map(Into::into),
        resets: json["resets"].as_array().map_or(0, Vec::len),
        lights: Lights {
            busy: is("busy"),
            ok: is("ok"),
            ng: is("ng"),
            // The board tells it by its status light, which is not an output to the machine.
            trouble: false,
        },
        laser_is_on: is("laser_enable"),
        is_configured: json["usb"]["configured"] == true,
        control_waiting: number(&json["uart"]["waiting"]),
        control_held: number(&json["uart"]["held"]),
        overruns: number(&json["uart"]["overruns"]),
        toggle_errors: number(&json["usb"]["toggle_errors"]),
        slept_cycles: number(&json["core"]["slept_cycles"]),
        cycles_per_second: number(&json["cycles_per_second"]),
        json,
    }
}
