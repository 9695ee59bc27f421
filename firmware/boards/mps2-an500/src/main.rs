//! openumi on the Cortex-M7 of QEMU's machine `mps2-an500`: the application unchanged, with
//! its control, its host and a distance sensor on three UARTs, and everything else on another ([`ports::bench`]).
//!
//! ```text
//! priority          runs
//! capture           UART 2; playing edges and axes
//! drivers           UARTs 0, 1 and 4, clock
//! serial tasks      receive, transmit, latch
//! link tasks        serve, sense; and telling the bench
//! none              measure, supervise, prove; starting anew, and the trial of an image
//! ```
//!
//! | file | idea |
//! | --- | --- |
//! | [`chip`] | addresses, interrupts, priorities |
//! | [`vectors`] | which function each interrupt runs |
//! | [`ports`] | a UART, and what is on each: control, host, distance sensor, bench |
//! | [`path`] | where the axes are |
//! | [`clock`], [`watchdog`] | time |
//! | [`storage`] | flash in RAM that outlives a reset |
//! | [`storage::owner`] | the board's key, and the keys of people |
//! | [`storage::images`] | signed images in slots |
//! | [`crash_note`] | why the board started, and where it panicked |
//!
//! # Limitations
//!
//! QEMU is no model of time: it says nothing about latency. For that there are the
//! emulated Pico, and real boards.
#![no_std]
#![no_main]

mod chip;
mod clock;
mod crash_note;
#[path = "../../common/fault_entry.rs"]
mod fault_entry;
mod path;
mod ports;
#[path = "../../common/stack_guard.rs"]
mod stack_guard;
mod storage;
mod vectors;
mod watchdog;

use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use embassy_executor::{Executor, InterruptExecutor, SpawnError, SpawnToken};
use static_cell::StaticCell;
use umi_app::measure::{Boot, StorageAreas};
use umi_app::sensor::PointStation;
use umi_app::{App, Running};
use umi_core::units::Micros;
use umi_drivers::latches::Latches;
use umi_protocol::job::name;
use umi_protocol::message::{Identity, ResetReason};

use chip::{Interrupt, peripheral};
use clock::BoardClock;
use crash_note::Cause;
use ports::uart::{Full, Uart};
use ports::{bench, control, link, sensor};
use storage::images::{ImageTrial, RunningImage};
use storage::{Region, images, owner};
use watchdog::WatchdogTimer;

/// To the control.
static CONTROL: Uart = Uart::new(peripheral::UART_0, Full::Counts);
/// To the host.
static HOST: Uart = Uart::new(peripheral::UART_1, Full::Holds);
/// To the test bench.
static BENCH: Uart = Uart::new(peripheral::UART_2, Full::Holds);
/// From the distance sensor.
static SENSOR: Uart = Uart::new(peripheral::UART_4, Full::Counts);
/// For who looks on: what a start has to say.
static CONSOLE: Uart = Uart::new(peripheral::UART_3, Full::Holds);

static APP: App<Region> = App::new();

static LATCHES: Latches = Latches::new();

/// Of the distance sensor.
static POINT: PointStation = PointStation::new();

static BENCH_TASK: InterruptExecutor = InterruptExecutor::new();
static SERIAL_TASKS: InterruptExecutor = InterruptExecutor::new();
static LINK_TASKS: InterruptExecutor = InterruptExecutor::new();

#[cortex_m_rt::entry]
fn main() -> ! {
    static TASKS: StaticCell<Executor> = StaticCell::new();

    let reset = note_reset(&crash_note::take_cause());
    // The first time it is always there.
    let Some(peripherals) = cortex_m::Peripherals::take() else {
        stop("the core is taken")
    };
    stack_guard::forbid_below_stack(&peripherals.MPU, 0);
    // SAFETY: nothing of the image is in the region.
    unsafe { peripherals.MPU.ctrl.write(stack_guard::CONTROL) };
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
    clock::start();
    // SAFETY: here and nowhere else.
    let mut kept = unsafe { storage::open() };
    let mut image = RunningImage::start(kept.images);
    let signer = owner::signer(kept.key, &mut kept.access, kept.entropy, image.digest);
    let boot = Boot {
        identity: Identity {
            board: name("mps2-an500"),
            serial: name("QEMU"),
            firmware: image.version(),
        },
        reset,
        line: control::ABILITIES,
        skip_ends: true,
        signer,
    };
    let app = &APP;
    let areas = StorageAreas {
        journal: kept.journal,
        evidence: Some(kept.evidence),
        custody: Some(kept.custody),
        settings: kept.settings,
        programs: kept.programs,
    };
    if let Err(Running) = app.guard(owner::keeper(kept.access, signer)) {
        stop("the application runs already");
    }
    if let Err(Running) = app.senses(&POINT) {
        stop("the application runs already");
    }
    image.enter(app);
    match app.start(boot, areas, Micros(0)) {
        Ok(opened) => {
            if opened.journal.is_err() || opened.settings.is_err() {
                CONSOLE.print("the storage holds something else: nothing is kept\n");
            }
            if opened.programs.is_err() {
                CONSOLE.print("no programs can be kept\n");
            }
        }
        Err(Running) => stop("the application runs already"),
    }
    image.tell(app, Micros(0));

    CONTROL.start();
    CONTROL.set_baud(app.line().baud);
    HOST.start();
    BENCH.start();
    SENSOR.start();
    vectors::enable(peripherals.NVIC);
    BENCH_TASK.start(Interrupt::BenchTask).spawn(first(play()));
    let serial = SERIAL_TASKS.start(Interrupt::SerialTasks);
    serial.spawn(first(receive(app)));
    serial.spawn(first(transmit(app)));
    serial.spawn(first(latch(app)));
    let link = LINK_TASKS.start(Interrupt::LinkTasks);
    link.spawn(first(serve(app)));
    link.spawn(first(sense(app)));
    link.spawn(first(tell()));
    let watchdog = WatchdogTimer::start();
    TASKS.init(Executor::new()).run(|here| {
        here.spawn(first(measure_on(app)));
        here.spawn(first(prove(app)));
        here.spawn(first(supervise(app, watchdog)));
        here.spawn(first(hang()));
        here.spawn(first(start_anew(app)));
        if let Some(trial) = image.trial() {
            here.spawn(first(end_trial(app, trial)));
        }
    })
}

/// A task that is started for the first time has its place.
fn first<S>(task: Result<SpawnToken<S>, SpawnError>) -> SpawnToken<S> {
    task.unwrap_or_else(|_| stop("a task was started twice"))
}

/// Says what is wrong and does nothing more.
fn stop(why: &str) -> ! {
    CONSOLE.print(why);
    CONSOLE.print("\n");
    loop {
        cortex_m::asm::wfi();
    }
}

#[embassy_executor::task]
async fn receive(app: &'static App<Region>) {
    app.receive(&mut control::Receiver, &BoardClock).await;
}

#[embassy_executor::task]
async fn transmit(app: &'static App<Region>) {
    app.transmit(&mut control::Transmitter, &BoardClock).await;
}

#[embassy_executor::task]
async fn latch(app: &'static App<Region>) {
    app.latch(&mut &LATCHES, &BoardClock).await;
}

#[embassy_executor::task]
async fn serve(app: &'static App<Region>) {
    let (mut rx, mut tx) = (link::LinkReceiver, link::LinkTransmitter);
    app.serve(&mut rx, &mut tx, &mut bench::Station, &BoardClock)
        .await;
}

#[embassy_executor::task]
async fn sense(app: &'static App<Region>) {
    app.sense(&mut sensor::SensorUart, &BoardClock).await;
}

#[embassy_executor::task]
async fn play() {
    bench::play().await;
}

#[embassy_executor::task]
async fn tell() {
    bench::tell().await;
}

#[embassy_executor::task]
async fn measure_on(app: &'static App<Region>) {
    app.measure(&mut bench::Lamps, &BoardClock).await;
}

/// Of the priority of measuring: a session takes this core a few milliseconds.
#[embassy_executor::task]
async fn prove(app: &'static App<Region>) {
    app.prove().await;
}

#[embassy_executor::task]
async fn supervise(app: &'static App<Region>, mut watchdog: WatchdogTimer) {
    app.supervise(&mut watchdog, &BoardClock).await;
}

#[embassy_executor::task]
async fn start_anew(app: &'static App<Region>) {
    images::restart_when_asked(app).await;
}

#[embassy_executor::task]
async fn end_trial(app: &'static App<Region>, trial: ImageTrial) {
    trial.end(app).await;
}

/// Hangs when the bench asks for it, as a fit would that never ends.
#[embassy_executor::task]
async fn hang() {
    bench::HANG.wait().await;
    loop {
        cortex_m::asm::nop();
    }
}

/// Says why the board started.
fn note_reset(cause: &Cause) -> ResetReason {
    CONSOLE.start();
    CONSOLE.print("umi-mps2-an500 ");
    CONSOLE.print(env!("CARGO_PKG_VERSION"));
    let reset = match cause {
        Cause::Power => ResetReason::PowerOn,
        Cause::External => ResetReason::Pin,
        Cause::Software => ResetReason::Software,
        Cause::Watchdog => {
            CONSOLE.print(" after its watchdog");
            ResetReason::Watchdog
        }
        Cause::Panic(place) => {
            CONSOLE.print(" after a panic at ");
            CONSOLE.print(place);
            ResetReason::Panic
        }
    };
    CONSOLE.print("\n");
    bench::note_reset(reset);
    reset
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    crash_note::note_panic(info);
    SCB::sys_reset()
}
