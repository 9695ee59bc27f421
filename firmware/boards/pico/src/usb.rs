//! The host's port: a serial port over USB (CDC-ACM).
//!
//! # Design
//!
//! A host is there while a program has the port open, which the host tells by DTR, and
//! the bus is awake. A
//! program that ends takes its connection along, even if a packet is on its way: the
//! application must know, as it then switches off what it has switched on.
//!
//! The maker's number is that of [pid.codes](https://pid.codes), which gives product
//! numbers to open hardware; 0x0001 is its number for tests. A board that is sold needs
//! one of its own. `umi` finds boards by the maker's name, not by numbers, and tells
//! them apart by their serial number: the unique number of the journal's memory.

use core::sync::atomic::{AtomicBool, Ordering};

use embassy_futures::select::{Either, select};
use embassy_rp::peripherals::USB;
use embassy_rp::usb::Driver;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::watch::{self, Watch};
use embassy_usb::class::cdc_acm::{self, CdcAcmClass, ControlChanged};
use embassy_usb::{Builder, Config, Handler, UsbDevice};
use static_cell::StaticCell;
use umi_app::board::{Broken, LinkRx, LinkTx};

const MAKER: u16 = 0x1209;
const PRODUCT: u16 = 0x0001;
/// A full-speed packet.
const PACKET: usize = 64;

type Controller = Driver<'static, USB>;

/// Whether a program has the port open, for both directions and who waits for one.
static OPEN: Watch<CriticalSectionRawMutex, bool, 2> = Watch::new();

/// Follows [`OPEN`].
type Open = watch::Receiver<'static, CriticalSectionRawMutex, bool, 2>;

/// What must run beside the ports.
pub struct Parts {
    /// The device itself.
    pub device: UsbDevice<'static, Controller>,
    /// What the host says about the line.
    pub line: ControlChanged<'static>,
    /// From the host.
    pub receiver: Receiver,
    /// To the host.
    pub transmitter: Transmitter,
}

/// A device with this serial number. None: it has been made before.
pub fn start(driver: Controller, serial: &'static str) -> Option<Parts> {
    static CONFIGURATION: StaticCell<[u8; 128]> = StaticCell::new();
    static BOS: StaticCell<[u8; 32]> = StaticCell::new();
    static CONTROL: StaticCell<[u8; 64]> = StaticCell::new();
    static STATE: StaticCell<cdc_acm::State<'static>> = StaticCell::new();
    static BUS: StaticCell<Bus> = StaticCell::new();

    let mut config = Config::new(MAKER, PRODUCT);
    config.manufacturer = Some("openumi");
    config.product = Some("openumi Pico");
    config.serial_number = Some(serial);
    config.max_power = 100;
    config.device_release = 0x0010;
    let mut builder = Builder::new(
        driver,
        config,
        CONFIGURATION.init([0; 128]),
        BOS.init([0; 32]),
        &mut [],
        CONTROL.init([0; 64]),
    );
    builder.handler(BUS.init(Bus));
    let class = CdcAcmClass::new(
        &mut builder,
        STATE.init(cdc_acm::State::new()),
        PACKET as u16,
    );
    let (sender, receiver, line) = class.split_with_control();
    Some(Parts {
        device: builder.build(),
        line,
        receiver: Receiver {
            port: receiver,
            open: OPEN.receiver()?,
            packet: [0; PACKET],
            next: 0,
            end: 0,
        },
        transmitter: Transmitter {
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

/// From the host.
pub struct Receiver {
    port: cdc_acm::Receiver<'static, Controller>,
    open: Open,
    packet: [u8; PACKET],
    /// What of the packet has not been asked for yet.
    next: usize,
    end: usize,
}

/// Waits until no program has the port open.
async fn closed(open: &mut Open) {
    open.get_and(|open| !*open).await;
}

impl LinkRx for Receiver {
    async fn connected(&mut self) {
        (self.next, self.end) = (0, 0);
        self.open.get_and(|open| *open).await;
    }

    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Broken> {
        while self.next >= self.end {
            self.next = 0;
            self.end = 0;
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
}

/// To the host.
pub struct Transmitter {
    port: cdc_acm::Sender<'static, Controller>,
    open: Open,
}

impl Transmitter {
    async fn packet(&mut self, bytes: &[u8]) -> Result<(), Broken> {
        match select(self.port.write_packet(bytes), closed(&mut self.open)).await {
            Either::First(Ok(())) => Ok(()),
            _ => Err(Broken),
        }
    }
}

impl LinkTx for Transmitter {
    async fn write(&mut self, bytes: &[u8]) -> Result<(), Broken> {
        for piece in bytes.chunks(PACKET) {
            self.packet(piece).await?;
        }
        // The host waits for more behind a full packet unless an empty one follows.
        if bytes.len().is_multiple_of(PACKET) && !bytes.is_empty() {
            self.packet(&[]).await?;
        }
        Ok(())
    }
}
