//! The host's port: a serial port over USB (CDC-ACM), on any controller.
//!
//! # Design
//!
//! A host is there while a program has the port open, which the host tells by DTR, and
//! the bus is awake. A
//! program that ends takes its connection along, even with a packet on its way: the
//! application must know, as it then switches off what it has switched on.
//!
//! The maker's number is that of [pid.codes](https://pid.codes), which gives product
//! numbers to open hardware; 0x0001 is its number for tests. A board that is sold needs
//! one of its own. Boards are told apart by their serial number.
//!
//! # Limitations
//!
//! Controllers are not `Send`: start it in the task that serves the host. One port in an image. There is no model of a USB host here: this is tested on boards.

use core::sync::atomic::{AtomicBool, Ordering};

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::watch::{self, Watch};
use embassy_usb::class::cdc_acm::{self, CdcAcmClass, ControlChanged};
use embassy_usb::driver::Driver;
use embassy_usb::{Builder, Config, Handler, UsbDevice};
use static_cell::StaticCell;
use umi_app::board::{Broken, Clock, LinkRx, LinkTx};
use umi_core::units::Micros;

use crate::usb_plug::{Attachment, LOOK_MS, Plug, PlugSeen};

const MAKER: u16 = 0x1209;
const PRODUCT: u16 = 0x0001;
/// A full-speed packet.
const PACKET: usize = 64;

/// Receiving and sending.
const DIRECTIONS: usize = 2;

type Open = watch::Receiver<'static, CriticalSectionRawMutex, bool, DIRECTIONS>;

/// Whether a program has the port open.
static OPEN: Watch<CriticalSectionRawMutex, bool, DIRECTIONS> = Watch::new();

/// What runs, each in its place.
pub struct UsbParts<D: Driver<'static>> {
    /// The device itself: to be run for ever.
    pub device: UsbDevice<'static, D>,
    /// What the host says about the line: for [`follow`].
    pub line: ControlChanged<'static>,
    /// From the host.
    pub receiver: UsbReceiver<D>,
    /// To the host.
    pub transmitter: UsbTransmitter<D>,
}

/// A device that calls itself `product`. `None`: it exists already.
pub fn start<D: Driver<'static>>(
    driver: D,
    product: &'static str,
    serial: &'static str,
) -> Option<UsbParts<D>> {
    static CONFIGURATION: StaticCell<[u8; 128]> = StaticCell::new();
    static BOS: StaticCell<[u8; 32]> = StaticCell::new();
    static CONTROL: StaticCell<[u8; 64]> = StaticCell::new();
    static STATE: StaticCell<cdc_acm::State<'static>> = StaticCell::new();
    static BUS: StaticCell<Bus> = StaticCell::new();

    let mut config = Config::new(MAKER, PRODUCT);
    config.manufacturer = Some("openumi");
    config.product = Some(product);
    config.serial_number = Some(serial);
    // In a cabinet it has its own supply; at a desk it takes that of the bus. One bit cannot say both: the
    // host is told of the current all the same.
    config.self_powered = true;
    config.max_power = 100;
    config.device_release = 0x0010;
    let mut builder = Builder::new(
        driver,
        config,
        CONFIGURATION.try_init([0; 128])?,
        BOS.try_init([0; 32])?,
        &mut [],
        CONTROL.try_init([0; 64])?,
    );
    builder.handler(BUS.try_init(Bus)?);
    let state = STATE.try_init(cdc_acm::State::new())?;
    let class = CdcAcmClass::new(&mut builder, state, PACKET as u16);
    let (sender, receiver, line) = class.split_with_control();
    Some(UsbParts {
        device: builder.build(),
        line,
        receiver: UsbReceiver {
            port: receiver,
            open: OPEN.receiver()?,
            packet: [0; PACKET],
            next: 0,
            end: 0,
        },
        transmitter: UsbTransmitter {
            port: sender,
            open: OPEN.receiver()?,
        },
    })
}

/// What the host said last: a program has the port open.
static ASKED: AtomicBool = AtomicBool::new(false);
/// The bus is there: configured and not suspended.
static AWAKE: AtomicBool = AtomicBool::new(false);

fn tell() {
    OPEN.sender()
        .send(ASKED.load(Ordering::Relaxed) && AWAKE.load(Ordering::Relaxed));
}

/// Follows what the host says about the line, for ever.
pub async fn follow(line: ControlChanged<'static>) -> ! {
    loop {
        line.control_changed().await;
        ASKED.store(line.dtr(), Ordering::Relaxed);
        tell();
    }
}

/// Shows the board to the host while that gives 5 V, and anew where nothing moves, for ever.
pub async fn keep_attached(mut plug: impl Plug, clock: &impl Clock) -> ! {
    let mut attachment = Attachment::new();
    loop {
        let was_shown = attachment.is_shown();
        let shown = attachment.look(PlugSeen {
            has_power: plug.has_power(),
            frame: plug.frame(),
            is_configured: AWAKE.load(Ordering::Relaxed),
            is_open: ASKED.load(Ordering::Relaxed),
        });
        if shown != was_shown {
            plug.show(shown);
            ASKED.store(false, Ordering::Relaxed);
            AWAKE.store(false, Ordering::Relaxed);
            tell();
        }
        let look = u64::from(LOOK_MS) * 1_000;
        clock
            .wait_until(Micros(clock.now().0.saturating_add(look)))
            .await;
    }
}

/// Follows the bus. A cable that is pulled takes DTR along without a word: a board with a
/// supply of its own only sees that the bus sleeps.
struct Bus;

impl Bus {
    fn is(&mut self, awake: bool) {
        AWAKE.store(awake, Ordering::Relaxed);
        tell();
    }
}

impl Handler for Bus {
    fn enabled(&mut self, enabled: bool) {
        if !enabled {
            self.is(false);
        }
    }

    fn reset(&mut self) {
        // A program opens the port anew behind it.
        ASKED.store(false, Ordering::Relaxed);
        self.is(false);
    }

    fn configured(&mut self, configured: bool) {
        self.is(configured);
    }

    fn suspended(&mut self, suspended: bool) {
        self.is(!suspended);
    }
}

/// Waits until no program has the port open.
async fn closed(open: &mut Open) {
    open.get_and(|open| !*open).await;
}

/// From the host.
pub struct UsbReceiver<D: Driver<'static>> {
    port: cdc_acm::Receiver<'static, D>,
    open: Open,
    packet: [u8; PACKET],
    /// What of the packet has not been asked for yet: from here...
    next: usize,
    /// ...to here.
    end: usize,
}

impl<D: Driver<'static>> LinkRx for UsbReceiver<D> {
    async fn connected(&mut self) {
        (self.next, self.end) = (0, 0);
        self.open.get_and(|open| *open).await;
    }

    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Broken> {
        while self.next >= self.end {
            (self.next, self.end) = (0, 0);
            let packet = self.port.read_packet(&mut self.packet);
            match select(packet, closed(&mut self.open)).await {
                Either::First(Ok(count)) => self.end = count,
                _ => return Err(Broken),
            }
        }
        let waiting = self.packet.get(self.next..self.end).unwrap_or_default();
        let count = waiting.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(waiting) {
            *place = *byte;
        }
        self.next += count;
        Ok(count)
    }

    async fn gone(&mut self) {
        closed(&mut self.open).await;
    }
}

/// To the host.
pub struct UsbTransmitter<D: Driver<'static>> {
    port: cdc_acm::Sender<'static, D>,
    open: Open,
}

impl<D: Driver<'static>> UsbTransmitter<D> {
    async fn packet(&mut self, bytes: &[u8]) -> Result<(), Broken> {
        match select(self.port.write_packet(bytes), closed(&mut self.open)).await {
            Either::First(Ok(())) => Ok(()),
            _ => Err(Broken),
        }
    }
}

impl<D: Driver<'static>> LinkTx for UsbTransmitter<D> {
    async fn write(&mut self, bytes: &[u8]) -> Result<(), Broken> {
        for piece in bytes.chunks(PACKET) {
            self.packet(piece).await?;
        }
        // Behind a full packet the host waits for more, unless an empty one follows.
        if bytes.len().is_multiple_of(PACKET) && !bytes.is_empty() {
            self.packet(&[]).await?;
        }
        Ok(())
    }
}
