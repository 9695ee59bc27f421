//! From one start of a virtual board to the next: what is plugged in stays, the application is new.

use std::cell::RefCell;
use std::io;
use std::rc::Rc;
use std::sync::mpsc::Sender as Started;

use tokio::runtime::Runtime;
use tokio::sync::mpsc::{Receiver, Sender, UnboundedReceiver};
use tokio::sync::oneshot;
use umi_app::App;
use umi_app::access::{Jumper, Keeper};
use umi_app::board::{Clock as _, LineAbilities};
use umi_app::measure::trust::heads::HeadSigner;
use umi_app::measure::{Boot, StorageAreas};
use umi_app::sensor::PointStation;
use umi_core::trust::board_key::NoEntropy;
use umi_core::units::Micros;
use umi_protocol::job::name;
use umi_protocol::message::{Identity, ResetReason};
use umi_protocol::serial::{LEAST_BAUD, MOST_BAUD};

use super::clock::VirtualClock;
use super::images::RunningImage;
use super::ports::{
    ControlRx, ControlTx, FromControl, FromHost, HostRx, HostTx, Lamps, Latched, Latches,
    NoWatchdog, SensorEnd, Station, TeachButton, Wire,
};
use super::waker::with_one_waker;
use super::{Config, key};

/// What is plugged into a board.
pub(super) struct Plugs {
    cnc_rx: ControlRx,
    cnc_tx: ControlTx,
    link_rx: HostRx,
    link_tx: HostTx,
    latches: Latches,
    station: Station,
    outputs: Lamps,
    button: TeachButton,
    sensor: SensorEnd,
}

impl Plugs {
    #[allow(clippy::too_many_arguments, reason = "one for each plug")]
    pub fn new(
        from_control: UnboundedReceiver<FromControl>,
        to_control: Sender<u8>,
        from_host: UnboundedReceiver<FromHost>,
        latches: Receiver<Latched>,
        line: Wire,
        station: Station,
        outputs: Lamps,
        button: TeachButton,
        sensor: SensorEnd,
    ) -> Self {
        let to_host = Rc::new(RefCell::new(None));
        Self {
            cnc_rx: ControlRx {
                incoming: from_control,
                rest: Vec::new(),
                line: line.clone(),
            },
            cnc_tx: ControlTx {
                outgoing: to_control,
                line,
            },
            link_rx: HostRx {
                incoming: from_host,
                to_host: Rc::clone(&to_host),
                rest: Vec::new(),
            },
            link_tx: HostTx { to_host },
            latches: Latches {
                incoming: latches,
                waiting: None,
            },
            station,
            outputs,
            button,
            sensor,
        }
    }
}

/// The switch, and who waits for the first start.
pub(super) struct Power {
    pub started: Option<Started<io::Result<()>>>,
    pub switched_off: oneshot::Receiver<()>,
}

impl Power {
    /// Runs the board from a start until it starts anew (true) or is switched off.
    pub fn cycle(
        &mut self,
        config: &Config,
        runtime: &Runtime,
        plugs: &mut Plugs,
        clock: &VirtualClock,
    ) -> bool {
        let is_first = self.started.is_some();
        let mut image = config
            .images
            .clone()
            .and_then(|areas| RunningImage::start(areas, config.firmware_key));
        let version = image.as_ref().map(RunningImage::version);
        let digest = image.as_ref().and_then(RunningImage::digest);
        let mut access = config.access.clone();
        let is_wiping = access.as_mut().is_some_and(Keeper::is_wiping);
        let signer = config
            .key
            .clone()
            .and_then(|flash| key::signer(flash, digest.unwrap_or_default(), is_wiping));
        let boot = Boot {
            identity: Identity {
                board: name("virtual"),
                serial: name(&config.serial),
                firmware: name(version.as_deref().unwrap_or(env!("CARGO_PKG_VERSION"))),
            },
            reset: match is_first {
                true => ResetReason::PowerOn,
                false => ResetReason::Software,
            },
            line: LineAbilities {
                least_baud: LEAST_BAUD,
                most_baud: MOST_BAUD,
                two_stop_bits: true,
                cts: false,
            },
            skip_ends: true,
            signer,
        };
        let now = match is_first {
            true => Micros(0),
            false => clock.now(),
        };
        let app = Box::new(App::new());
        guard(&app, config, signer, now);
        // Storage that cannot be opened shows as on a real board: in its answers.
        let areas = StorageAreas {
            journal: config.journal.clone(),
            evidence: config.evidence.clone(),
            custody: config.custody.clone(),
            settings: config.settings.clone(),
            programs: config.programs.clone(),
        };
        if let Some(image) = &mut image {
            image.enter(&app);
        }
        // As long as the board, as its keys: no task has begun.
        let _ = app.senses(Box::leak(Box::new(PointStation::new())));
        let _ = app.start(boot, areas, now);
        if let Some(image) = &image {
            image.tell(&app, now);
        }
        plugs.cnc_rx.line.board.set(app.line());
        if let Some(started) = self.started.take() {
            let _ = started.send(Ok(()));
        }
        let Plugs {
            cnc_rx,
            cnc_tx,
            link_rx,
            link_tx,
            latches,
            station,
            outputs,
            button,
            sensor,
        } = plugs;
        let switched_off = &mut self.switched_off;
        let mut dog = NoWatchdog;
        let given_up = async {
            match &mut image {
                Some(image) => image.given_up(&app, clock).await,
                None => std::future::pending().await,
            }
        };
        let restarts = runtime.block_on(with_one_waker(async {
            tokio::select! {
                biased;
                () = app.receive(cnc_rx, clock) => false,
                () = app.measure(outputs, clock) => false,
                () = app.transmit(cnc_tx, clock) => false,
                () = app.serve(link_rx, link_tx, station, clock) => false,
                () = app.prove() => false,
                () = app.latch(latches, clock) => false,
                () = app.supervise(&mut dog, clock) => false,
                () = app.button(button, clock) => false,
                () = app.sense(sensor, clock) => false,
                () = app.restarts() => true,
                () = given_up => true,
                _ = switched_off => false,
            }
        }));
        // As a board on USB that starts anew: it is plugged in again.
        link_rx.unplug();
        restarts
    }
}

/// Gives the board its keys, if it can have an owner.
fn guard(
    app: &App<super::VirtualFlash>,
    config: &Config,
    signer: Option<&'static HeadSigner>,
    now: Micros,
) {
    let Some(flash) = config.access.clone() else {
        return;
    };
    let jumper: Jumper = if config.jumper { || true } else { || false };
    let draw = |bytes: &mut [u8; 32]| getrandom::fill(bytes).map_err(|_| NoEntropy);
    let keeper = Keeper::open(flash, jumper, signer, draw, now);
    // No task has begun.
    let _ = app.guard(keeper);
}
