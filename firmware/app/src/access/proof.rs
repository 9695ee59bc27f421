//! What takes long about a session, below measuring.
//!
//! # Design
//!
//! Drawing a share takes a chip without a multiplier for long numbers a third of a second, proving a
//! session two thirds. In the host's task, which is above measuring, a verdict would wait for it. So
//! that task only hands it over, and waits for it as it waits for a fit; [`Prover::run`] does it in
//! the lowest priority of all.
//!
//! # Limitations
//!
//! A session waits for a fit. On a board with one executor measuring waits for either half.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use umi_core::trust::access::session::{
    BoardHandshake, BoardSession, BoardShare, SignatureParts, ToSign,
};
use umi_core::trust::board_key::NoEntropy;

use crate::measure::trust::signer::HeadSigner;

/// Fills 32 bytes from the board's source of entropy.
pub type Draw = fn(&mut [u8; 32]) -> Result<(), NoEntropy>;

/// What is to be done.
#[allow(clippy::large_enum_variant, reason = "no heap; one exists at a time")]
pub enum Work {
    /// Draw what a challenge is made of.
    Draw(Draw),
    /// Look at a host's proof.
    Prove {
        /// What it proves.
        handshake: BoardHandshake,
        /// The proof.
        signature: SignatureParts,
        /// Who signs for the board.
        signer: &'static HeadSigner,
    },
}

/// What came of it.
pub enum Worked {
    /// None: there is no entropy.
    Drawn(Option<BoardShare>),
    /// The host's proof of this key.
    Proven {
        /// The host's.
        key: [u8; 32],
        /// The session and the board's own proof; none: the host's is wrong.
        opens: Option<(BoardSession, SignatureParts)>,
    },
}

impl Work {
    /// Does it.
    #[must_use]
    pub fn done(self) -> Worked {
        match self {
            Self::Draw(draw) => Worked::Drawn(drawn(draw)),
            Self::Prove {
                handshake,
                signature,
                signer,
            } => Worked::Proven {
                key: *handshake.key(),
                opens: opened(handshake, signature)
                    .map(|(session, signed)| (session, signer.sign(&signed))),
            },
        }
    }
}

// The sums take kilobytes of the stack each: none stands on that of another.

#[inline(never)]
fn drawn(draw: Draw) -> Option<BoardShare> {
    let (mut challenge, mut secret) = ([0; 32], [0; 32]);
    draw(&mut challenge).ok()?;
    draw(&mut secret).ok()?;
    Some(BoardShare::new(challenge, secret))
}

#[inline(never)]
fn opened(handshake: BoardHandshake, signature: SignatureParts) -> Option<(BoardSession, ToSign)> {
    handshake.prove(signature)
}

/// Between the host's task and the lowest priority. Memory is short: one place for both directions.
pub(crate) struct Prover {
    between: Mutex<CriticalSectionRawMutex, Cell<Between>>,
    is_handed_over: Signal<CriticalSectionRawMutex, ()>,
    is_done: Signal<CriticalSectionRawMutex, ()>,
}

enum Between {
    Nothing,
    Work(Work),
    Worked(Worked),
}

impl Prover {
    pub const fn new() -> Self {
        Self {
            between: Mutex::new(Cell::new(Between::Nothing)),
            is_handed_over: Signal::new(),
            is_done: Signal::new(),
        }
    }

    fn replace(&self, between: Between) -> Between {
        self.between.lock(|place| place.replace(between))
    }

    /// Hands work over. What came of earlier work, for a host that is gone, is dropped.
    #[inline(never)]
    pub fn hand_over(&self, work: Work) {
        self.is_done.reset();
        self.replace(Between::Work(work));
        self.is_handed_over.signal(());
    }

    /// Waits until it is done.
    pub async fn done(&self) {
        self.is_done.wait().await;
    }

    /// What came of it.
    #[inline(never)]
    pub fn take(&self) -> Option<Worked> {
        match self.replace(Between::Nothing) {
            Between::Worked(worked) => Some(worked),
            Between::Work(_) | Between::Nothing => None,
        }
    }

    /// Does what comes, for ever.
    pub async fn run(&self) -> ! {
        loop {
            self.is_handed_over.wait().await;
            self.work();
        }
    }

    #[inline(never)]
    fn work(&self) {
        let Between::Work(work) = self.replace(Between::Nothing) else {
            return;
        };
        let worked = work.done();
        // Meanwhile another host may have come with work of its own: this is for nobody.
        let is_for_nobody = self.between.lock(|place| {
            let before = place.replace(Between::Worked(worked));
            let is_newer = matches!(before, Between::Work(_));
            if is_newer {
                place.set(before);
            }
            is_newer
        });
        if !is_for_nobody {
            self.is_done.signal(());
        }
    }
}
