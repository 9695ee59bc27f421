//! The host's port: requests are answered, events told.
//!
//! # Design
//!
//! A host that does not read stops this task and nothing else: the state is
//! locked only while an answer is made, never while it is sent. A connection
//! that comes back starts anew, without events until they are asked for.

use core::convert::Infallible;

use embassy_futures::select::{Either, Either3, select, select3};
use umi_core::journal::Flash;
use umi_protocol::decoder::Decoder;
use umi_protocol::frame::{Frame, Kind, MAX_BOARD_FRAME, MAX_HOST_FRAME, encode};
use umi_protocol::hello::Hello;
use umi_protocol::latch::TriggerOut;
use umi_protocol::message::{Event, Request};

use crate::App;
use crate::answer::{Surroundings, answer};
use crate::board::{Axes, Broken, Clock, LinkRx, LinkTx, Scanner};
use crate::measure::Measure;
use crate::shared::Guard;

/// Bytes taken from the link at once: a full-speed USB packet.
const PACKET: usize = 64;

/// Serves hosts for ever.
pub(crate) async fn serve<F: Flash>(
    app: &App<F>,
    rx: &mut impl LinkRx,
    tx: &mut impl LinkTx,
    station: &mut (impl Axes + Scanner),
    clock: &impl Clock,
) -> ! {
    let mut out = [0; MAX_BOARD_FRAME];
    loop {
        rx.connected().await;
        let Err(Broken) = connection(app, rx, tx, station, clock, &mut out).await;
        // What the host has switched on goes with it. A board without these outputs has
        // nothing to switch off.
        let _ = station.trigger_out(TriggerOut::Off);
        let _ = station.laser(false);
        app.scans.switch(false);
        app.measure.lock().await.book.events.switch(false);
    }
}

/// Never returns but by a broken link.
async fn connection<F: Flash>(
    app: &App<F>,
    rx: &mut impl LinkRx,
    tx: &mut impl LinkTx,
    station: &mut (impl Axes + Scanner),
    clock: &impl Clock,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> Result<Infallible, Broken> {
    // What the last connection left unfinished is no part of this one.
    let mut decoder = Decoder::<MAX_HOST_FRAME>::new();
    loop {
        let mut packet = [0; PACKET];
        let came = select3(rx.read(&mut packet), app.told.wait(), app.scans.came()).await;
        if let Either3::First(count) = came {
            let mut bytes = packet.get(..count?).unwrap_or_default();
            loop {
                let link_damaged = decoder.counters().damaged();
                let Some(frame) = decoder.next_frame(&mut bytes) else {
                    break;
                };
                let answer = {
                    let mut measure = lock(app, tx, out).await?;
                    let around = Surroundings {
                        now: clock.now(),
                        link_damaged,
                        scans: &app.scans,
                        station,
                    };
                    respond(&mut measure, around, &frame, out)
                };
                app.changed.signal(());
                if !answer.is_empty() {
                    tx.write(answer).await?;
                }
            }
        }
        tell_scans(app, tx, out).await?;
        loop {
            // The lock ends with this statement: measuring never waits for a host.
            let popped = lock(app, tx, out).await?.book.events.pop(out);
            let Some(frame) = popped else {
                break;
            };
            tx.write(frame).await?;
        }
    }
}

/// Locks the state. A fit may hold it for long: triggers go on to the host meanwhile.
async fn lock<'a, F: Flash>(
    app: &'a App<F>,
    tx: &mut impl LinkTx,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> Result<Guard<'a, Measure<F>>, Broken> {
    loop {
        match select(app.measure.lock(), app.scans.came()).await {
            Either::First(measure) => return Ok(measure),
            Either::Second(()) => tell_scans(app, tx, out).await?,
        }
    }
}

/// Tells the host the latches that wait.
async fn tell_scans<F: Flash>(
    app: &App<F>,
    tx: &mut impl LinkTx,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> Result<(), Broken> {
    while let Some(batch) = app.scans.batch() {
        // Latches are numbered themselves: the number of the frame counts other events.
        let frame = encode(0, &Event::Latches(batch), out);
        // The buffer holds the longest frame.
        tx.write(frame.unwrap_or_default()).await?;
    }
    Ok(())
}

/// The answer to a frame. What cannot be opened is answered with a Hello: it says
/// who we are and which messages we know. What only a board sends is our own,
/// echoed by the line, and is not answered: the echo would go round for ever.
///
/// Messages are large: here they are on the stack only while one is answered.
#[inline(never)]
fn respond<'b, F: Flash>(
    measure: &mut Measure<F>,
    around: Surroundings<'_, impl Axes + Scanner>,
    frame: &Frame<'_>,
    out: &'b mut [u8; MAX_BOARD_FRAME],
) -> &'b [u8] {
    let length = match frame.kind {
        Kind::Response | Kind::Event => 0,
        Kind::Request => {
            request(measure, around, frame, out).unwrap_or_else(|| hello(measure, frame, out))
        }
        Kind::Other(_) => hello(measure, frame, out),
        Kind::Hello => {
            let ours = Hello::new(&measure.book.sender());
            if frame.open::<Hello>().as_ref() == Ok(&ours) {
                return &[];
            }
            // A host that begins has not asked for events yet.
            measure.book.events.switch(false);
            around.scans.switch(false);
            hello(measure, frame, out)
        }
    };
    out.get(..length).unwrap_or_default()
}

/// Who we are: the length of the frame.
#[inline(never)]
fn hello<F: Flash>(
    measure: &Measure<F>,
    frame: &Frame<'_>,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> usize {
    let hello = Hello::new(&measure.book.sender());
    // The buffer holds the longest frame.
    encode(frame.sequence, &hello, out).map_or(0, <[u8]>::len)
}

/// The answer to a request: the length of its frame; none if it cannot be opened.
#[inline(never)]
fn request<F: Flash>(
    measure: &mut Measure<F>,
    around: Surroundings<'_, impl Axes + Scanner>,
    frame: &Frame<'_>,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> Option<usize> {
    let Ok(request) = &frame.open::<Request>() else {
        return None;
    };
    let response = answer(measure, around, request);
    // The buffer holds the longest frame.
    Some(encode(frame.sequence, &response, out).map_or(0, <[u8]>::len))
}
