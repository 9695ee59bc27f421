//! openumi on the Raspberry Pi Pico: the application unchanged, with four axes that
//! state machines decode and latch.
//!
//! ```text
//! encoders ──► PIO 0: four decoders ──► DMA ──► rings of 82 us ─┐
//! skip, trigger, index, pulses ──► PIO 1: stamps ──► interrupt ─┴─► captures ──► latch
//! trigger out ◄── PIO 1: pulses ◄── tick
//! control ◄──► UART 0 ◄──► receive, transmit
//! host ◄──► USB ◄──► serve
//! ```
//!
//! | file | idea |
//! | --- | --- |
//! | [`pins`] | which pin is what |
//! | [`safety::before_main`] | what a reset leaves |
//! | [`resources`] | clock, machines, channels, priorities |
//! | [`capture::pio`] | what the state machines run, and how they are started |
//! | [`capture::rings`] | samples in memory |
//! | [`capture::quadrature`] | 64-bit positions at an instant |
//! | [`capture::stamps`], [`capture::edge_pins`] | edges to instants |
//! | [`capture::latch`], [`time::tick`] | captures |
//! | [`capture::rate_limit`] | no line keeps the processor |
//! | [`capture::trigger_out`] | pulses to a scanner |
//! | [`measuring_level`] | a fifth level of priority |
//! | [`uart`] | the control's port; the host's is [`umi_drivers::usb_serial`] |
//! | [`usb_plug`] | when the board shows itself to a host |
//! | [`storage`] | journal, evidence, settings and part programs |
//! | [`storage::owner`] | the board's key, the keys of people, the jumper |
//! | `storage::images`, `storage::updates` (../common/updates.rs) | signed images, where a boot loader starts them (bin/boot.rs) |
//! | `storage::ab_images` | the same where the boot ROM of a Pico 2 starts them |
//! | [`safety::guard`], [`safety::crash_note`], [`lights`], [`time::clock`], [`time::alarms`] | watchdog, panics, outputs, time |
//!
//! # Limitations
//!
//! It has run in an emulator only. See the README beside this crate.
#![no_std]
#![no_main]

mod capture;
mod lights;
mod measuring_level;
mod pins;
mod resources;
mod safety;
mod storage;
mod time;
mod uart;
mod usb_plug;

use core::fmt::Write as _;
use core::panic::PanicInfo;

use cortex_m_rt::exception;
use cortex_m_rt::interrupt;
use defmt_rtt as _;
use embassy_executor::{Executor, InterruptExecutor, SpawnError, SpawnToken};
use embassy_futures::join::join4;
use embassy_rp::gpio::{Level, Output};
use embassy_rp::interrupt;
use embassy_rp::interrupt::InterruptExt;
use embassy_rp::peripherals::USB;
use embassy_rp::usb::{Driver, InterruptHandler};
use embassy_rp::watchdog::Watchdog;
use embassy_rp::{Peri, bind_interrupts};
use embassy_time::{Duration, Timer};
use heapless::String;
use portable_atomic as _;
use static_cell::StaticCell;
use umi_app::measure::{Boot, StorageAreas};
use umi_app::{App, Running};
use umi_drivers::usb_serial;
use umi_protocol::job::{Name, name};
use umi_protocol::message::{Identity, ResetReason};
use umi_protocol::update::ImageVersion;

use capture::latch;
use capture::latch::Station;
use clock::BoardClock;
use lights::Lamps;
use safety::guard::Dog;
use safety::{crash_note, guard};
use storage::chip_flash::{ChipFlash, KEY};
#[cfg(feature = "update")]
use storage::updates;
use storage::{Part, Storage, owner};
use time::{alarms, clock};
use umi_app::access::Keeper;
use umi_app::board::Clock as _;

bind_interrupts!(struct Interrupts {
    USBCTRL_IRQ => InterruptHandler<USB>;
});

static APP: App<Part> = App::new();

/// Receive, transmit, latch.
static CONTROL_TASKS: InterruptExecutor = InterruptExecutor::new();
/// Serve.
static HOST_TASKS: InterruptExecutor = InterruptExecutor::new();

/// Two digits for each byte of the memory's unique number.
type Serial = String<16>;

#[cortex_m_rt::entry]
fn main() -> ! {
    static TASKS: StaticCell<Executor> = StaticCell::new();

    let parts = boot();
    let app = &APP;
    let control = CONTROL_TASKS.start(interrupt::SWI_IRQ_3);
    control.spawn(first(receive(app)));
    control.spawn(first(transmit(app)));
    control.spawn(first(latch_on(app)));
    let host = HOST_TASKS.start(interrupt::SWI_IRQ_1);
    host.spawn(first(serve(app, parts.usb, parts.serial, parts.station)));
    host.spawn(first(check_in()));
    #[cfg(feature = "update")]
    host.spawn(first(end_trial(app)));
    let measuring = measuring_level::start();
    measuring.spawn(first(measure_on(app, parts.lamps)));
    measuring.spawn(first(supervise(app, parts.dog)));
    measuring.spawn(first(start_anew(app)));
    TASKS
        .init(Executor::new())
        .run(|here| here.spawn(first(prove(app))))
}

/// What the tasks begin with.
struct Parts {
    usb: Peri<'static, USB>,
    serial: &'static str,
    station: Station,
    lamps: Lamps,
    dog: Dog,
}

/// Starts everything but the tasks. What it needs of the stack is free again afterwards.
#[inline(never)]
fn boot() -> Parts {
    static SERIAL: StaticCell<Serial> = StaticCell::new();

    let chip = embassy_rp::init(Default::default());
    alarms::start(resources::SERIAL);
    let watchdog = Watchdog::new(chip.WATCHDOG);
    let reset = why_started(&watchdog);
    let mut light = Output::new(chip.PIN_25, Level::High);
    let lamps = Lamps {
        ok: Output::new(chip.PIN_26, Level::Low),
        ng: Output::new(chip.PIN_27, Level::Low),
        busy: Output::new(chip.PIN_28, Level::Low),
    };
    let station = Station::new(Output::new(chip.PIN_21, Level::Low));
    if embassy_rp::clocks::clk_sys_freq() != resources::CLOCK_HZ {
        stop(&mut light, "the clock is not what the plan says");
    }
    // The rings wait for nobody on the bus.
    embassy_rp::pac::BUSCTRL.bus_priority().write(|w| {
        w.set_dma_r(true);
        w.set_dma_w(true);
    });
    pins::mux::connect();
    // Before anything that cannot wait: its flash is the one that all code is fetched from.
    #[cfg(feature = "update")]
    let Some(mut image) = storage::running_image(&chip.FLASH) else {
        stop(
            &mut light,
            "this image is older than what counts, or not the maker's",
        );
    };
    #[cfg(feature = "update")]
    let (digest, version) = (image.digest, image.version);
    // The boot ROM restarts by the watchdog what it was asked to try.
    #[cfg(feature = "slot-ab")]
    let reset = match reset {
        ResetReason::Watchdog if image.is_on_trial() => ResetReason::Software,
        seen => seen,
    };
    #[cfg(not(feature = "update"))]
    let (digest, version) = ([0; 32], None);
    let mut own = ChipFlash::new(chip.FLASH, KEY);
    let signer = owner::signer(&mut own, digest, false);
    latch::start();

    let mut storage = storage::open(storage::StorageParts {
        spi: chip.SPI0,
        miso: chip.PIN_4,
        select: chip.PIN_5,
        clock: chip.PIN_6,
        mosi: chip.PIN_7,
    });
    let signer = match signer {
        None if Keeper::is_wiping(&mut storage.access) => owner::signer(&mut own, digest, true),
        signer => signer,
    };
    let serial = SERIAL.init(Serial::new());
    for byte in storage.unique_id {
        let _ = write!(serial, "{byte:02X}");
    }
    let boot = Boot {
        identity: Identity {
            board: name("pico"),
            serial: name(serial),
            firmware: firmware(version),
        },
        reset,
        line: uart::ABILITIES,
        skip_ends: true,
        signer,
    };
    let Storage {
        journal,
        settings,
        programs,
        evidence,
        custody,
        access,
        ..
    } = storage;
    let areas = StorageAreas {
        journal,
        evidence: Some(evidence),
        custody: Some(custody),
        settings,
        programs,
    };
    let now = BoardClock.now();
    if let Err(Running) = APP.guard(owner::keeper(access, signer, now)) {
        stop(&mut light, "the application runs already");
    }
    #[cfg(feature = "update")]
    image.enter(&APP);
    match APP.start(boot, areas, now) {
        Ok(opened) => {
            if opened.journal.is_err() || opened.settings.is_err() {
                defmt::error!("the storage cannot be used: nothing is kept");
            }
            if opened.programs.is_err() {
                defmt::error!("no programs can be kept");
            }
        }
        Err(Running) => stop(&mut light, "the application runs already"),
    }
    #[cfg(feature = "update")]
    image.tell(&APP, now);
    let dog = Dog::start(watchdog, light);

    uart::start(APP.line());
    set_priorities();
    Parts {
        usb: chip.USB,
        serial,
        station,
        lamps,
        dog,
    }
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

/// Of what the drivers and executors do not set themselves.
fn set_priorities() {
    interrupt::SWI_IRQ_3.set_priority(resources::CONTROL_TASKS);
    interrupt::SWI_IRQ_1.set_priority(resources::HOST_TASKS);
    interrupt::USBCTRL_IRQ.set_priority(resources::HOST_TASKS);
    // SAFETY: the interrupt is not enabled yet, and nobody else has the controller here.
    unsafe {
        let mut core = cortex_m::Peripherals::steal();
        core.NVIC
            .set_priority(interrupt::SWI_IRQ_4, resources::MEASURING);
    }
}

/// A task that is started for the first time has its place.
fn first<S>(task: Result<SpawnToken<S>, SpawnError>) -> SpawnToken<S> {
    match task {
        Ok(token) => token,
        Err(_) => {
            defmt::error!("a task was started twice");
            guard::reset_now()
        }
    }
}

/// Says what is wrong and does nothing more than to blink quickly.
fn stop(light: &mut Output<'static>, why: &'static str) -> ! {
    defmt::error!("{=str}", why);
    loop {
        light.toggle();
        cortex_m::asm::delay(resources::CLOCK_HZ / 20);
    }
}

/// Why the board started; where it panicked is told to who looks on.
fn why_started(watchdog: &Watchdog) -> ResetReason {
    match crash_note::take() {
        Some(place) => {
            defmt::error!("started after a panic: {=str}", place.as_str());
            ResetReason::Panic
        }
        None => guard::reset_reason(watchdog),
    }
}

#[embassy_executor::task]
async fn receive(app: &'static App<Part>) {
    app.receive(&mut uart::Receiver, &BoardClock).await;
}

#[embassy_executor::task]
async fn transmit(app: &'static App<Part>) {
    app.transmit(&mut uart::Transmitter, &BoardClock).await;
}

#[embassy_executor::task]
async fn latch_on(app: &'static App<Part>) {
    app.latch(&mut &latch::CAPTURES, &BoardClock).await;
}

/// The device is made here, where it stays.
#[embassy_executor::task]
async fn serve(
    app: &'static App<Part>,
    usb: Peri<'static, USB>,
    serial: &'static str,
    mut station: Station,
) {
    let driver = Driver::new(usb, Interrupts);
    let Some(mut link) = usb_serial::start(driver, "openumi Pico", serial) else {
        return;
    };
    join4(
        link.device.run(),
        usb_serial::follow(link.line),
        usb_serial::keep_attached(usb_plug::UsbPlug, &BoardClock),
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
async fn check_in() {
    guard::host_level().await;
}

#[embassy_executor::task]
async fn measure_on(app: &'static App<Part>, mut lamps: Lamps) {
    app.measure(&mut lamps, &BoardClock).await;
}

#[embassy_executor::task]
async fn supervise(app: &'static App<Part>, mut dog: Dog) {
    app.supervise(&mut dog, &BoardClock).await;
}

#[embassy_executor::task]
async fn prove(app: &'static App<Part>) {
    app.prove().await;
}

/// A wipe is asked for: the next start carries it out.
#[embassy_executor::task]
async fn start_anew(app: &'static App<Part>) {
    app.restarts().await;
    // The host reads the answer first.
    Timer::after(Duration::from_millis(200)).await;
    guard::reset_now()
}

#[cfg(feature = "update")]
#[embassy_executor::task]
async fn end_trial(app: &'static App<Part>) {
    updates::end_trial(app, guard::reset_now).await;
}

#[interrupt]
unsafe fn SWI_IRQ_3() {
    // SAFETY: this is the interrupt that the executor was started with.
    unsafe { CONTROL_TASKS.on_interrupt() }
}

#[interrupt]
unsafe fn SWI_IRQ_1() {
    // SAFETY: this is the interrupt that the executor was started with.
    unsafe { HOST_TASKS.on_interrupt() }
}

/// The core cannot go on: from `safety::fault_entry`.
#[unsafe(no_mangle)]
extern "C" fn on_fault(address: u32) -> ! {
    guard::dark();
    crash_note::note_fault(address);
    guard::reset_now()
}

/// An exception or an interrupt that nothing here has asked for.
#[exception]
unsafe fn DefaultHandler(_: i16) -> ! {
    guard::reset_now()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    guard::dark();
    crash_note::note_panic(info);
    guard::reset_now()
}

#[defmt::panic_handler]
fn defmt_panic() -> ! {
    guard::reset_now()
}
