//! openumi on a Nucleo-144 with an STM32H743: the application unchanged, five axes that one
//! edge latches in hardware. **It has never been run**: see README.md.
//!
//! ```text
//! priority          runs
//! capture           TIM5: an edge; TIM7: a look at the counters
//! drivers           USART2, USART6, TIM12 (the tasks' time)
//! serial tasks      receive, transmit, latch
//! sensor task       sense
//! link driver       USB: wakes the link's task
//! link tasks        USB, serve
//! none              measure, prove, supervise
//! ```
//!
//! | file | idea |
//! | --- | --- |
//! | [`start`] | clocks and priorities, as each image has them |
//! | [`resources`] | which pin, timer and clock does what; checked when it is compiled |
//! | [`timers`] | registers that count and capture |
//! | [`axes`] | positions and captures |
//! | [`time`] | the application's clock, and the tasks' timer |
//! | [`ports::control`] | the control's RS-232 |
//! | [`ports::sensor`] | a distance sensor's line, pulses and outputs |
//! | [`ports::usb`] | the interrupt of USB, and its plug |
//! | [`storage`] | journal, evidence, settings and part programs |
//! | [`storage::owner`] | the board's key, the keys of people, the jumper |
//! | `storage::images`, `storage::updates` (../common/updates.rs) | signed images, where a boot loader starts them (bin/boot.rs) |
//! | [`storage::chip_flash`] | the flash that the code runs from, whose words have check values |
//! | [`memory`] | what is in which memory, and cached |
//! | [`reset`], [`ram_note`] | why the board started; panics; what a reset leaves |
//!
//! The driver of the serial flash, USB and queues are in `umi-drivers`.
#![no_std]
#![no_main]

mod axes;
#[path = "../../common/fault_entry.rs"]
mod fault_entry;
mod memory;
mod ports;
mod ram_note;
mod reset;
#[allow(
    dead_code,
    clippy::indexing_slicing,
    reason = "build.rs reads what is not used here; in a constant the compiler finds what is outside"
)]
mod resources;
#[path = "../../common/stack_guard.rs"]
mod stack_guard;
mod start;
mod storage;
mod time;
mod timers;

use core::fmt::Write as _;

use defmt_rtt as _;
use embassy_executor::{Executor, InterruptExecutor, SpawnError, SpawnToken};
use embassy_futures::join::join5;
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::peripherals::{IWDG1, PA11, PA12, USB_OTG_FS};
use embassy_stm32::spi::{self, Spi};
use embassy_stm32::time::Hertz;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peri, interrupt, rcc, uid};
use embassy_time::{Delay, Timer};
use embedded_hal_bus::spi::ExclusiveDevice;
use static_cell::StaticCell;
use umi_app::access::Keeper;
use umi_app::board::{Button, Clock as _, Lights, Outputs, Watchdog};
use umi_app::measure::{Boot, StorageAreas};
use umi_app::sensor::PointStation;
use umi_app::{App, Running};
use umi_drivers::usb_serial;
use umi_protocol::job::{Name, name};
use umi_protocol::message::Identity;
use umi_protocol::update::ImageVersion;

use ports::{control, sensor, usb};
use storage::{Part, Storage, owner};
#[cfg(feature = "update")]
use storage::{images, updates};
use time::alarms;
use time::clock::BoardClock;

type Application = App<Part>;

static APP: Application = App::new();

/// Of the distance sensor.
static POINT: PointStation = PointStation::new();

#[unsafe(link_section = ".dtcm")]
static SERIAL_TASKS: InterruptExecutor = InterruptExecutor::new();
static SENSOR_TASKS: InterruptExecutor = InterruptExecutor::new();
static LINK_TASKS: InterruptExecutor = InterruptExecutor::new();

#[cortex_m_rt::entry]
fn main() -> ! {
    static TASKS: StaticCell<Executor> = StaticCell::new();

    let reset = reset::reason();
    let p = embassy_stm32::init(start::configuration());
    // Before anything that takes time: nothing moves and nothing shines meanwhile.
    let station = axes::Station {
        laser: Output::new(p.PG0, Level::Low, Speed::Low),
    };
    let low = Speed::Low;
    let port = sensor::SensorEnd {
        skip: Output::new(p.PF12, Level::Low, low),
        parity: Output::new(p.PG1, Level::Low, low),
        is_ok: Output::new(p.PG2, Level::Low, low),
        has_no_signal: Output::new(p.PG3, Level::Low, low),
    };
    let lamps = Lamps {
        ok: Output::new(p.PF13, Level::Low, Speed::Low),
        ng: Output::new(p.PF14, Level::Low, Speed::Low),
        busy: Output::new(p.PF15, Level::Low, Speed::Low),
        trouble: Output::new(p.PB14, Level::Low, Speed::Low),
    };
    let blue = Blue(Input::new(p.PC13, Pull::Down));
    if let Some(mut core) = cortex_m::Peripherals::take() {
        memory::cache(&core.MPU, &mut core.SCB, &mut core.CPUID);
    }
    if rcc::frequency::<embassy_stm32::peripherals::TIM5>() != Hertz(resources::TIMER_HZ) {
        stop("the timers' clock is not as planned");
    }
    owner::pull_up_jumper(p.PF8);
    // Before anything that cannot wait. The key first: what counts of the images stands behind it.
    let key = owner::board_key(false);
    #[cfg(feature = "update")]
    let mut image = updates::running(
        images::open(Part::Chip).and_then(updates::found),
        images::take_reverted(),
    );
    #[cfg(feature = "update")]
    let (digest, version) = (image.digest, image.version);
    #[cfg(not(feature = "update"))]
    let (digest, version) = ([0; 32], None);
    start::set_priorities();
    timers::start();
    timers::start_looking();
    alarms::start();
    control::start(Output::new(p.PD4, Level::Low, low));
    sensor::start();

    let select = Output::new(p.PE4, Level::High, Speed::VeryHigh);
    let mut speed = spi::Config::default();
    speed.frequency = Hertz(resources::FLASH_HZ);
    let bus = Spi::new_blocking(p.SPI4, p.PE2, p.PE6, p.PE5, speed);
    let Ok(device) = ExclusiveDevice::new(bus, select, Delay);
    let Storage {
        journal,
        evidence,
        settings,
        programs,
        custody,
        mut access,
    } = storage::open(device).unwrap_or_else(|why| stop(why));
    let key = match key {
        None if Keeper::is_wiping(&mut access) => owner::board_key(true),
        key => key,
    };
    let signer = owner::signer(key, digest);
    let boot = Boot {
        identity: Identity {
            board: name("nucleo-h743"),
            serial: name(uid::uid_hex()),
            firmware: firmware(version),
        },
        reset,
        line: control::ABILITIES,
        skip_ends: true,
        signer,
    };
    let app = &APP;
    let areas = StorageAreas {
        journal,
        evidence: Some(evidence),
        custody: Some(custody),
        settings,
        programs,
    };
    if let Err(Running) = app.senses(&POINT) {
        stop("the application runs already");
    }
    let now = BoardClock.now();
    if let Err(Running) = app.guard(owner::keeper(access, signer, now)) {
        stop("the application runs already");
    }
    #[cfg(feature = "update")]
    image.enter(app);
    match app.start(boot, areas, now) {
        Ok(opened) => {
            if opened.journal.is_err() || opened.settings.is_err() {
                defmt::error!("the storage cannot be opened");
            }
            if opened.programs.is_err() {
                defmt::error!("no programs can be kept");
            }
        }
        Err(Running) => stop("the application runs already"),
    }
    #[cfg(feature = "update")]
    image.tell(app, now);
    // Until now nobody has read what came; the control prints when its program runs.
    control::set(app.line());

    let mut dog = IndependentWatchdog::new(p.IWDG1, resources::WATCHDOG_US);
    dog.unleash();

    let serial = SERIAL_TASKS.start(interrupt::UART4);
    serial.spawn(first(receive(app)));
    serial.spawn(first(transmit(app)));
    serial.spawn(first(latch(app)));
    serial.spawn(first(button(app, blue)));
    let sensing = SENSOR_TASKS.start(interrupt::UART7);
    sensing.spawn(first(sense(app, port)));
    let link = LINK_TASKS.start(interrupt::UART5);
    link.spawn(first(serve(app, p.USB_OTG_FS, p.PA12, p.PA11, station)));
    TASKS.init(Executor::new()).run(|here| {
        here.spawn(first(measure(app, lamps)));
        here.spawn(first(prove(app)));
        here.spawn(first(start_anew(app)));
        here.spawn(first(supervise(app, Dog(dog))));
        #[cfg(feature = "update")]
        here.spawn(first(end_trial(app)));
    })
}

/// The version that the board tells: of a signed image that of its header, which says what may run.
fn firmware(signed: Option<ImageVersion>) -> Name {
    let Some([major, minor, patch]) = signed else {
        return name(env!("CARGO_PKG_VERSION"));
    };
    let mut text = Name::new();
    // Three numbers of five digits have room.
    let _ = write!(text, "{major}.{minor}.{patch}");
    text
}

/// Runs the tasks of the serial line.
#[interrupt]
fn UART4() {
    // SAFETY: this is the interrupt that the executor was started with.
    unsafe { SERIAL_TASKS.on_interrupt() }
}

/// Runs the task of the distance sensor.
#[interrupt]
fn UART7() {
    // SAFETY: this is the interrupt that the executor was started with.
    unsafe { SENSOR_TASKS.on_interrupt() }
}

/// Runs the tasks of the link.
#[interrupt]
fn UART5() {
    // SAFETY: this is the interrupt that the executor was started with.
    unsafe { LINK_TASKS.on_interrupt() }
}

/// Says what is wrong, and does nothing more.
fn stop(why: &str) -> ! {
    defmt::error!("{}", why);
    loop {
        cortex_m::asm::wfi();
    }
}

/// A task that is started for the first time has its place.
fn first<S>(task: Result<SpawnToken<S>, SpawnError>) -> SpawnToken<S> {
    task.unwrap_or_else(|_| stop("a task was started twice"))
}

#[embassy_executor::task]
async fn receive(app: &'static Application) {
    app.receive(&mut control::Receiver, &BoardClock).await;
}

#[embassy_executor::task]
async fn transmit(app: &'static Application) {
    app.transmit(&mut control::Transmitter, &BoardClock).await;
}

#[embassy_executor::task]
async fn latch(app: &'static Application) {
    app.latch(&mut &axes::LATCHES, &BoardClock).await;
}

#[embassy_executor::task]
async fn sense(app: &'static Application, mut port: sensor::SensorEnd) {
    app.sense(&mut port, &BoardClock).await;
}

#[embassy_executor::task]
async fn button(app: &'static Application, mut blue: Blue) {
    app.button(&mut blue, &BoardClock).await;
}

/// USB and the application's part of it: in one task, as a controller stays where it was
/// started.
#[embassy_executor::task]
async fn serve(
    app: &'static Application,
    controller: Peri<'static, USB_OTG_FS>,
    dp: Peri<'static, PA12>,
    dm: Peri<'static, PA11>,
    mut station: axes::Station,
) {
    static BUFFER: StaticCell<[u8; 256]> = StaticCell::new();
    let mut options = embassy_stm32::usb::Config::default();
    // The board may have its power from elsewhere, and then must not pull the line of a port that is
    // off (USB 2.0, 7.1.5.1): the controller looks at PA9.
    options.vbus_detection = true;
    let buffer = BUFFER.init([0; 256]);
    let driver =
        embassy_stm32::usb::Driver::new_fs(controller, usb::Served, dp, dm, buffer, options);
    let Some(mut link) = usb_serial::start(driver, "openumi Nucleo-H743", uid::uid_hex()) else {
        stop("USB was started twice")
    };
    // The device first: its first step starts the controller.
    join5(
        link.device.run(),
        usb::serve(),
        usb_serial::follow(link.line),
        usb_serial::keep_attached(usb::UsbPlug, &BoardClock),
        app.serve(
            &mut link.receiver,
            &mut link.transmitter,
            &mut station,
            &BoardClock,
        ),
    )
    .await;
}

#[embassy_executor::task]
async fn measure(app: &'static Application, mut lamps: Lamps) {
    app.measure(&mut lamps, &BoardClock).await;
}

/// Of the priority of measuring: a session takes this core a few milliseconds.
#[embassy_executor::task]
async fn prove(app: &'static Application) {
    app.prove().await;
}

/// A wipe is asked for: the next start carries it out.
#[embassy_executor::task]
async fn start_anew(app: &'static Application) {
    app.restarts().await;
    // The host reads the answer first.
    Timer::after_millis(200).await;
    reset::start_anew()
}

#[cfg(feature = "update")]
#[embassy_executor::task]
async fn end_trial(app: &'static Application) {
    updates::end_trial(app, reset::reset_now).await;
}

#[embassy_executor::task]
async fn supervise(app: &'static Application, mut dog: Dog) {
    app.supervise(&mut dog, &BoardClock).await;
}

/// The outputs to the machine, and the red LED.
struct Lamps {
    ok: Output<'static>,
    ng: Output<'static>,
    busy: Output<'static>,
    trouble: Output<'static>,
}

impl Outputs for Lamps {
    fn show(&mut self, lights: Lights) {
        self.busy.set_level(lights.busy.into());
        self.ok.set_level(lights.ok.into());
        self.ng.set_level(lights.ng.into());
        self.trouble.set_level(lights.trouble.into());
    }
}

/// The blue button B1: high while it is pressed.
struct Blue(Input<'static>);

impl Button for Blue {
    fn is_pressed(&mut self) -> bool {
        self.0.is_high()
    }
}

struct Dog(IndependentWatchdog<'static, IWDG1>);

impl Watchdog for Dog {
    fn feed(&mut self) {
        self.0.pet();
    }
}
