//! The host's port: requests are answered, events told.
//!
//! # Design
//!
//! A host that does not read stops this task and nothing else: the state is
//! locked only while an answer is made, never while it is sent. A connection
//! that comes back starts anew, without events until they are asked for.

use embassy_futures::select::{Either, select};
use umi_core::journal::Flash;
use umi_protocol::decoder::Decoder;
use umi_protocol::frame::{Frame, Kind, MAX_BOARD_FRAME, MAX_HOST_FRAME, encode};
use umi_protocol::hello::Hello;
use umi_protocol::message::Request;

use crate::App;
use crate::answer::answer;
use crate::board::{Broken, Clock, LinkRx, LinkTx};

/// Bytes taken from the link at once: a full-speed USB packet.
const PACKET: usize = 64;

/// Serves hosts for ever.
pub(crate) async fn serve<F: Flash>(
    app: &App<F>,
    rx: &mut impl LinkRx,
    tx: &mut impl LinkTx,
    clock: &impl Clock,
) -> ! {
    let mut decoder;
    let mut out = [0; MAX_BOARD_FRAME];
    loop {
        rx.connected().await;
        // What the last connection left unfinished is no part of this one.
        decoder = Decoder::new();
        let Err(Broken) = connection(app, rx, tx, clock, &mut decoder, &mut out).await;
        app.measure.lock().await.book.events.switch(false);
    }
}

/// Never returns but by a broken link.
async fn connection<F: Flash>(
    app: &App<F>,
    rx: &mut impl LinkRx,
    tx: &mut impl LinkTx,
    clock: &impl Clock,
    decoder: &mut Decoder<MAX_HOST_FRAME>,
    out: &mut [u8; MAX_BOARD_FRAME],
) -> Result<core::convert::Infallible, Broken> {
    loop {
        let mut packet = [0; PACKET];
        match select(rx.read(&mut packet), app.told.wait()).await {
            Either::First(count) => {
                let mut bytes = packet.get(..count?).unwrap_or_default();
                while let Some(frame) = decoder.next_frame(&mut bytes) {
                    let answer = respond(app, clock, &frame, out).await;
                    if !answer.is_empty() {
                        tx.write(answer).await?;
                    }
                }
            }
            Either::Second(()) => {}
        }
        loop {
            // The lock ends with this statement: measuring never waits for a host.
            let popped = app.measure.lock().await.book.events.pop(out);
            let Some(frame) = popped else {
                break;
            };
            tx.write(frame).await?;
        }
    }
}

/// The answer to a frame. What cannot be opened is answered with a Hello: it says
/// who we are and which messages we know. What only a board sends is our own,
/// echoed by the line, and is not answered: the echo would go round for ever.
async fn respond<'b, F: Flash>(
    app: &App<F>,
    clock: &impl Clock,
    frame: &Frame<'_>,
    out: &'b mut [u8; MAX_BOARD_FRAME],
) -> &'b [u8] {
    let mut measure = app.measure.lock().await;
    let encoded = match (frame.kind, frame.open::<Request>()) {
        (Kind::Request, Ok(request)) => {
            let response = answer(&mut measure, clock.now(), request);
            app.changed.signal(());
            encode(frame.sequence, &response, out)
        }
        (Kind::Response | Kind::Event, _) => return &[],
        (kind, _) => {
            let hello = Hello::new(&measure.book.sender());
            if kind == Kind::Hello {
                if frame.open::<Hello>().as_ref() == Ok(&hello) {
                    return &[];
                }
                // A host that begins has not asked for events yet.
                measure.book.events.switch(false);
            }
            encode(frame.sequence, &hello, out)
        }
    };
    // The buffer holds the longest frame.
    encoded.unwrap_or_default()
}
