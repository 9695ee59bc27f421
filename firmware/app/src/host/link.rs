//! The host's port: requests are answered, events told.
//!
//! # Design
//!
//! A host that does not read stops this task and nothing else: the state is
//! locked only while an answer is made, never while it is sent. A connection
//! that comes back starts anew, without events until they are asked for.
//!
//! A fit may hold the state for seconds. Where the axes are, trigger pulses and the laser need
//! nothing of it: such a request is answered meanwhile, and what the host has switched on goes
//! off as soon as the host is gone, whatever it waits for. It goes off, too, when a host that
//! is still there says nothing for [`SILENCE_US`]: it hangs. Time in which the board keeps it
//! waiting does not count.
//!
//! # Limitations
//!
//! Requests are answered in their order: one behind another that waits for a fit waits, too.

use core::cell::Cell;
use core::convert::Infallible;
use core::future::pending;
use core::pin::pin;

use embassy_futures::select::{Either, Either3, Either4, select, select3, select4};
use postcard::Deserializer;
use postcard::de_flavors::Slice;
use serde::Deserialize as _;
use umi_core::journal::Flash;
use umi_core::units::Micros;
use umi_protocol::access::AccessRefusal;
use umi_protocol::decoder::Decoder;
use umi_protocol::frame::{
    Authenticated, Frame, Kind, MAX_BOARD_FRAME, MAX_HOST_FRAME, Message, encode, encode_sealed,
};
use umi_protocol::hello::Hello;
use umi_protocol::immediate::ImmediateRequest;
use umi_protocol::latch::{TriggerOut, TriggerRefusal};
use umi_protocol::message::{Event, Request, Response};

use crate::App;
use crate::access::{self, Caller, Guarded};
use crate::board::{Axes, Broken, Clock, LinkRx, LinkTx, Scanner};
use crate::host::answer::{RequestContext, answer, immediate};
use crate::measure::Instrument;
use crate::sensor::PointStation;
use crate::shared::Guard;

/// Bytes taken from the link at once: a full-speed USB packet.
const PACKET: usize = 64;

/// A host that has switched laser or trigger pulses on and says nothing for so long hangs.
pub const SILENCE_US: u64 = 5_000_000;

/// What is heard of a host.
#[derive(Default)]
struct HostLiveness {
    at_us: Cell<u64>,
    /// What it has switched on.
    laser: Cell<bool>,
    pulses: Cell<bool>,
    /// The board keeps it waiting.
    waits: Cell<bool>,
}

impl HostLiveness {
    fn now(&self, clock: &impl Clock) {
        self.at_us.set(clock.now().0);
    }

    fn due(&self) -> Micros {
        Micros(self.at_us.get().saturating_add(SILENCE_US))
    }

    /// Waits until the host hangs.
    async fn nothing(&self, clock: &impl Clock) {
        loop {
            clock.wait_until(self.due()).await;
            if self.waits.get() || !(self.laser.get() || self.pulses.get()) {
                self.now(clock);
            } else if clock.now() >= self.due() {
                return;
            }
        }
    }
}

/// Serves hosts for ever.
pub(crate) async fn serve<F: Flash>(
    app: &App<F>,
    rx: &mut impl LinkRx,
    tx: &mut impl LinkTx,
    station: &mut (impl Axes + Scanner),
    clock: &impl Clock,
) -> ! {
    let mut out = [0; MAX_BOARD_FRAME];
    let mut guarded = app.guarded.lock().await;
    loop {
        rx.connected().await;
        let liveness = HostLiveness::default();
        liveness.now(clock);
        let connected = connection(
            app,
            rx,
            tx,
            station,
            clock,
            &liveness,
            &mut guarded,
            &mut out,
        );
        let ended = select(connected, liveness.nothing(clock)).await;
        // What the host has switched on goes with it. A board without these outputs has
        // nothing to switch off.
        if !app.point().is_some_and(PointStation::has_the_pulses) {
            let _ = station.trigger_out(TriggerOut::Off);
        }
        let _ = station.laser(false);
        if let Either::Second(()) = ended {
            // It is told what happens if it wakes.
            continue;
        }
        guarded.disconnected();
        app.scans.switch(false);
        let mut measure = app.measure.lock().await;
        measure.ledger.events.switch(false);
        measure.host_gone();
        // As the job says again.
        let _ = measure.listen(None);
        app.config_changed.signal(());
        if measure.ledger.upload.host_gone() {
            app.line.cancel();
        }
    }
}

/// Never returns but by a broken link.
#[allow(
    clippy::too_many_arguments,
    reason = "the ends of the link and who uses it"
)]
async fn connection<F: Flash>(
    app: &App<F>,
    rx: &mut impl LinkRx,
    tx: &mut impl LinkTx,
    station: &mut (impl Axes + Scanner),
    clock: &impl Clock,
    liveness: &HostLiveness,
    guarded: &mut Guarded<F>,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> Result<Infallible, Broken> {
    // What the last connection left unfinished is no part of this one.
    let mut decoder = Decoder::<MAX_HOST_FRAME>::new();
    // There may be events.
    let mut events = true;
    loop {
        let mut packet = [0; PACKET];
        let free = async {
            match events {
                true => app.measure.lock().await,
                false => pending().await,
            }
        };
        match select4(
            free,
            rx.read(&mut packet),
            app.events_pending.wait(),
            app.scans.came(),
        )
        .await
        {
            Either4::First(mut measure) => {
                let event = measure.ledger.events.pop(out);
                // Measuring never waits for a host.
                drop(measure);
                match event {
                    Some(frame) => tx.write(frame).await?,
                    None => events = false,
                }
            }
            Either4::Second(count) => {
                let mut bytes = packet.get(..count?).unwrap_or_default();
                loop {
                    let link_damaged = decoder.counters().damaged();
                    let Some(frame) = decoder.next_frame(&mut bytes) else {
                        break;
                    };
                    if matches!(
                        frame.kind,
                        Kind::Request | Kind::SealedRequest | Kind::Hello
                    ) {
                        liveness.now(clock);
                    }
                    let came = guarded.opened(&frame, clock.now());
                    let takes_long = came
                        .as_ref()
                        .is_some_and(|(frame, _)| guarded.prepare(frame, &app.prover));
                    if takes_long {
                        let done = app.prover.done();
                        meanwhile(done, app, rx, tx, clock, liveness, out).await?;
                        guarded.prepared(&app.prover);
                    }
                    let at_once = came.and_then(|(frame, caller)| {
                        respond_immediately(
                            app.point(),
                            station,
                            liveness,
                            guarded,
                            &caller,
                            &frame,
                            out,
                        )
                    });
                    let length = match at_once {
                        Some(length) => length,
                        None => {
                            events = true;
                            let mut measure = lock(app, rx, tx, clock, liveness, out).await?;
                            let (frame, caller) = came.unwrap_or((frame, Caller::NOBODY));
                            let around = RequestContext {
                                now: clock.now(),
                                link_damaged,
                                scans: &app.scans,
                                guarded,
                                caller,
                            };
                            app.config_changed.signal(());
                            respond(&mut measure, station, around, &frame, out)
                        }
                    };
                    if length > 0 {
                        tx.write(out.get(..length).unwrap_or_default()).await?;
                    }
                    if guarded.restarts {
                        app.restart.signal(());
                    }
                }
            }
            Either4::Third(()) => events = true,
            Either4::Fourth(()) => {}
        }
        tell_scans(app, tx, out).await?;
    }
}

/// Locks the state. A fit may hold it for long.
async fn lock<'a, F: Flash>(
    app: &'a App<F>,
    rx: &mut impl LinkRx,
    tx: &mut impl LinkTx,
    clock: &impl Clock,
    liveness: &HostLiveness,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> Result<Guard<'a, Instrument<F>>, Broken> {
    meanwhile(app.measure.lock(), app, rx, tx, clock, liveness, out).await
}

/// Waits for something: meanwhile triggers go on to the host, and it is seen if that has gone.
async fn meanwhile<T, F: Flash>(
    what: impl Future<Output = T>,
    app: &App<F>,
    rx: &mut impl LinkRx,
    tx: &mut impl LinkTx,
    clock: &impl Clock,
    liveness: &HostLiveness,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> Result<T, Broken> {
    let mut what = pin!(what);
    loop {
        liveness.waits.set(true);
        let came = select3(what.as_mut(), app.scans.came(), rx.gone()).await;
        liveness.waits.set(false);
        liveness.now(clock);
        match came {
            Either3::First(done) => return Ok(done),
            Either3::Second(()) => tell_scans(app, tx, out).await?,
            Either3::Third(()) => return Err(Broken),
        }
    }
}

/// Tells the host one message of latches that wait. For the next one it is called again: latches
/// that come as fast as they are told would keep a request waiting for ever.
async fn tell_scans<F: Flash>(
    app: &App<F>,
    tx: &mut impl LinkTx,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> Result<(), Broken> {
    match latches(app, out) {
        0 => Ok(()),
        length => tx.write(out.get(..length).unwrap_or_default()).await,
    }
}

/// The frame of the latches that wait: its length, 0 if there are none to tell. A message is large: it
/// is on the stack only while it is encoded.
#[inline(never)]
fn latches<F: Flash>(app: &App<F>, out: &mut [u8; MAX_BOARD_FRAME]) -> usize {
    let Some(batch) = app.scans.batch() else {
        return 0;
    };
    // Latches are numbered themselves: the number of the frame counts other events. The buffer holds
    // the longest frame.
    encode(0, &Event::Latches(batch), out).map_or(0, |frame| frame.len())
}

/// The answer to a request that needs nothing of the state: the length of its frame; none to
/// all else, and to one that its host may not ask: that is journaled.
#[inline(never)]
fn respond_immediately<F: Flash>(
    point: Option<&'static PointStation>,
    station: &mut (impl Axes + Scanner),
    liveness: &HostLiveness,
    guarded: &Guarded<F>,
    caller: &Caller,
    frame: &Frame<'_>,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> Option<usize> {
    let request = ImmediateRequest::of(frame)?;
    guarded.permits(caller, &request).ok()?;
    let answer = match request {
        ImmediateRequest::TriggerOut(_) if point.is_some_and(PointStation::has_the_pulses) => {
            Response::TriggerRefused(TriggerRefusal::OfTheSensor)
        }
        _ => immediate(station, request),
    };
    match request {
        ImmediateRequest::TriggerOut(when) if matches!(answer, Response::Done) => {
            liveness.pulses.set(when != TriggerOut::Off);
        }
        ImmediateRequest::Laser(on) if matches!(answer, Response::Done) => liveness.laser.set(on),
        _ => {}
    }
    Some(sealed(guarded, caller, frame, &answer, out))
}

/// The answer to a frame: its length, or 0. What cannot be opened is answered with a Hello: it
/// says who we are and which messages we know. What only a board sends is our own,
/// echoed by the line, and is not answered: the echo would go round for ever.
///
/// Messages are large: here they are on the stack only while one is answered.
#[inline(never)]
fn respond<F: Flash>(
    measure: &mut Instrument<F>,
    station: &mut (impl Axes + Scanner),
    around: RequestContext<'_, F>,
    frame: &Frame<'_>,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> usize {
    match frame.kind {
        Kind::Response | Kind::Event | Kind::SealedResponse => 0,
        // Of a session that there is not.
        Kind::SealedRequest if frame.is_of_this_schema() => {
            let why = AccessRefusal::NoSession;
            measure.refuse_access(around.now, why, None);
            refused(around.guarded, &Caller::NOBODY, frame, why, out)
        }
        Kind::SealedRequest => hello(measure, frame, out),
        Kind::Request => request(measure, station, around, frame, out)
            .unwrap_or_else(|| hello(measure, frame, out)),
        Kind::Other(_) => hello(measure, frame, out),
        Kind::Hello => {
            let ours = Hello::new(&measure.ledger.sender());
            if frame.open::<Hello>().as_ref() == Ok(&ours) {
                return 0;
            }
            // A host that begins has not asked for events yet.
            measure.ledger.events.switch(false);
            around.scans.switch(false);
            hello(measure, frame, out)
        }
    }
}

/// Who we are: the length of the frame.
#[inline(never)]
fn hello<F: Flash>(
    measure: &Instrument<F>,
    frame: &Frame<'_>,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> usize {
    encoded(frame, &Hello::new(&measure.ledger.sender()), out)
}

/// The answer to a request: the length of its frame; none if it cannot be opened.
#[inline(never)]
fn request<F: Flash>(
    measure: &mut Instrument<F>,
    station: &mut (impl Axes + Scanner),
    around: RequestContext<'_, F>,
    frame: &Frame<'_>,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> Option<usize> {
    let mut reader = frame.reader::<Request>().ok()?;
    let read = read(&mut reader);
    let request = read.as_ref().ok()?;
    if !reader.finalize().is_ok_and(<[u8]>::is_empty) {
        return None;
    }
    let RequestContext {
        now,
        link_damaged,
        scans,
        guarded,
        caller,
    } = around;
    if let Err(why) = access::admit(measure, guarded, now, &caller, request) {
        return Some(refused(guarded, &caller, frame, why, out));
    }
    if let Some(key_id) = caller.key_id {
        measure.ledger.by.put(key_id);
    }
    let around = RequestContext {
        now,
        link_damaged,
        scans,
        guarded: &mut *guarded,
        caller,
    };
    let response = answer(measure, station, around, request);
    measure.ledger.by.clear();
    Some(sealed(guarded, &caller, frame, &response, out))
}

/// What reading a request needs is on the stack only here. What is returned is where it stays.
#[inline(never)]
fn read<'f>(reader: &mut Deserializer<'f, Slice<'f>>) -> Result<Request, postcard::Error> {
    Request::deserialize(reader)
}

/// Puts the answer to a frame into the buffer: its length.
fn encoded(frame: &Frame<'_>, answer: &impl Message, out: &mut [u8; MAX_BOARD_FRAME]) -> usize {
    // The buffer holds the longest frame.
    encode(frame.sequence, answer, out).map_or(0, <[u8]>::len)
}

/// Refuses a request: the length of the frame.
#[inline(never)]
fn refused<F: Flash>(
    guarded: &Guarded<F>,
    caller: &Caller,
    frame: &Frame<'_>,
    why: AccessRefusal,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> usize {
    sealed(guarded, caller, frame, &Response::AccessRefused(why), out)
}

/// Puts the answer to a frame into the buffer, with a seal if the frame had one: its length.
#[inline(never)]
fn sealed<F: Flash>(
    guarded: &Guarded<F>,
    caller: &Caller,
    frame: &Frame<'_>,
    answer: &Response,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> usize {
    match caller.counter.filter(|_| cfg!(feature = "owner")) {
        None => encoded(frame, answer, out),
        Some(counter) => {
            let code = |of: &Authenticated<'_>| guarded.code(of);
            encode_sealed(frame.sequence, answer, counter, &code, out).map_or(0, <[u8]>::len)
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::cell::{Cell, RefCell};
    use std::collections::VecDeque;
    use std::vec::Vec;

    use core::future::poll_fn;
    use core::pin::Pin;
    use core::task::Poll;
    use embassy_futures::{block_on, poll_once};
    use umi_protocol::latch::{Positions, SignalLevel, TriggerPulse, TriggerRefusal};

    use super::*;
    use crate::board::Unsupported;
    use crate::test_board::{Hand, NoFlash};

    /// A host, its cable, and what it switches on the board.
    #[derive(Default)]
    struct Host {
        plugged: Cell<bool>,
        says: RefCell<VecDeque<u8>>,
        heard: RefCell<Vec<u8>>,
        /// It does not read.
        is_deaf: Cell<bool>,
        laser: Cell<bool>,
        pulses: Cell<bool>,
    }

    impl Host {
        fn asks(&self, request: &Request) {
            let mut out = [0; MAX_HOST_FRAME];
            let frame = encode(1, request, &mut out).unwrap();
            self.says.borrow_mut().extend(frame.iter());
        }

        /// What it was answered since it last looked.
        fn answers(&self) -> Vec<Response> {
            let heard = self.heard.take();
            let mut bytes = heard.as_slice();
            let mut decoder = Decoder::<MAX_BOARD_FRAME>::new();
            let mut answers = Vec::new();
            while let Some(frame) = decoder.next_frame(&mut bytes) {
                answers.push(frame.open().unwrap());
            }
            answers
        }
    }

    impl LinkRx for &Host {
        async fn connected(&mut self) {
            poll_fn(|_| match self.plugged.get() {
                true => Poll::Ready(()),
                false => Poll::Pending,
            })
            .await;
        }

        async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Broken> {
            poll_fn(|_| {
                let mut says = self.says.borrow_mut();
                if !self.plugged.get() {
                    return Poll::Ready(Err(Broken));
                }
                let count = says.len().min(buffer.len());
                for (place, byte) in buffer.iter_mut().zip(says.drain(..count)) {
                    *place = byte;
                }
                match count {
                    0 => Poll::Pending,
                    count => Poll::Ready(Ok(count)),
                }
            })
            .await
        }

        async fn gone(&mut self) {
            poll_fn(|_| match self.plugged.get() {
                true => Poll::Pending,
                false => Poll::Ready(()),
            })
            .await;
        }
    }

    impl LinkTx for &Host {
        async fn write(&mut self, bytes: &[u8]) -> Result<(), Broken> {
            poll_fn(|_| match self.is_deaf.get() {
                true => Poll::Pending,
                false => Poll::Ready(()),
            })
            .await;
            self.heard.borrow_mut().extend(bytes);
            Ok(())
        }
    }

    impl Axes for &Host {
        fn positions(&mut self) -> Positions {
            Positions::default()
        }
    }

    impl Scanner for &Host {
        fn trigger_out(&mut self, when: TriggerOut) -> Result<(), TriggerRefusal> {
            self.pulses.set(when != TriggerOut::Off);
            Ok(())
        }

        fn laser(&mut self, on: bool) -> Result<(), Unsupported> {
            self.laser.set(on);
            Ok(())
        }
    }

    const EVERY_MS: TriggerOut = TriggerOut::Time {
        interval_us: 1000,
        pulse: TriggerPulse {
            width_us: 20,
            rests: SignalLevel::Low,
        },
    };

    /// Runs until nothing is left to do.
    fn settle(mut run: Pin<&mut impl Future>) {
        for _ in 0..100 {
            assert!(poll_once(run.as_mut()).is_pending());
        }
    }

    /// A fit holds the state: laser and trigger pulses are switched all the same, and
    /// positions told. While another request waits for the fit, the cable is pulled: both are
    /// off at once, and the next host is answered when the fit is over.
    #[test]
    fn a_fit_keeps_no_laser_on() {
        let (app, clock, host) = (App::<NoFlash>::new(), Hand::default(), Host::default());
        let (mut rx, mut tx, mut station) = (&host, &host, &host);
        let mut run = pin!(serve(&app, &mut rx, &mut tx, &mut station, &clock));
        host.plugged.set(true);
        let fit = block_on(app.measure.lock());
        for on in [false, true] {
            host.asks(&Request::LaserSet { on });
        }
        host.asks(&Request::TriggerOutSet(EVERY_MS));
        host.asks(&Request::PositionsGet);
        settle(run.as_mut());
        assert!(host.laser.get() && host.pulses.get());
        let expected = [
            Response::Done,
            Response::Done,
            Response::Done,
            Response::Positions(Positions::default()),
        ];
        assert_eq!(host.answers(), expected);
        host.asks(&Request::StatusGet);
        settle(run.as_mut());
        assert!(host.answers().is_empty() && host.laser.get());
        host.plugged.set(false);
        settle(run.as_mut());
        assert!(!host.laser.get() && !host.pulses.get());
        drop(fit);
        settle(run.as_mut());
        assert!(host.answers().is_empty(), "nobody is there");
        host.plugged.set(true);
        host.asks(&Request::StatusGet);
        settle(run.as_mut());
        assert!(matches!(host.answers().as_slice(), [Response::Status(_)]));
        assert!(!host.laser.get() && !host.pulses.get());
    }

    /// A host that hangs with its cable in leaves neither laser nor pulses on for longer than
    /// it may be silent. One that asks for anything keeps them, and so does one that the
    /// board itself keeps waiting. When it wakes, it is answered as before.
    #[test]
    fn a_host_that_hangs_keeps_no_laser_on() {
        let (app, clock, host) = (App::<NoFlash>::new(), Hand::default(), Host::default());
        let (mut rx, mut tx, mut station) = (&host, &host, &host);
        let mut run = pin!(serve(&app, &mut rx, &mut tx, &mut station, &clock));
        let is_lit = || (host.laser.get(), host.pulses.get());
        host.plugged.set(true);
        // Silence before does not count.
        clock.set(3 * SILENCE_US);
        settle(run.as_mut());
        let mut now = 4 * SILENCE_US;
        clock.set(now);
        host.asks(&Request::LaserSet { on: true });
        host.asks(&Request::TriggerOutSet(EVERY_MS));
        settle(run.as_mut());
        for _ in 0..3 {
            now += SILENCE_US - 1;
            clock.set(now);
            settle(run.as_mut());
            assert_eq!(is_lit(), (true, true));
            host.asks(&Request::PositionsGet);
            settle(run.as_mut());
        }
        let fit = block_on(app.measure.lock());
        host.asks(&Request::StatusGet);
        for _ in 0..3 {
            settle(run.as_mut());
            now += SILENCE_US;
            clock.set(now);
        }
        settle(run.as_mut());
        assert_eq!(is_lit(), (true, true));
        drop(fit);
        settle(run.as_mut());
        now += SILENCE_US - 1;
        clock.set(now);
        settle(run.as_mut());
        assert_eq!(is_lit(), (true, true));
        clock.set(now + 1);
        settle(run.as_mut());
        assert_eq!(is_lit(), (false, false));
        host.answers();
        host.asks(&Request::LaserSet { on: true });
        settle(run.as_mut());
        assert_eq!(host.answers(), [Response::Done]);
        assert_eq!(is_lit(), (true, false));
        // Nor does one that asks and does not read what it is answered.
        host.is_deaf.set(true);
        host.asks(&Request::PositionsGet);
        settle(run.as_mut());
        host.asks(&Request::PositionsGet);
        clock.set(now + 2 * SILENCE_US);
        settle(run.as_mut());
        assert_eq!(is_lit(), (false, false));
    }
}
