//! A board's journal, entry by entry, verified as it comes; and its signed head.
//!
//! The head is asked for at the end, over a nonce that nobody can have signed before; what is pulled
//! ends with it. Entries that the board overwrites meanwhile are named, and the pull goes on.

use std::time::{Duration, Instant};

use umi_core::journal::{Chain, Entry, EntryIter, FileHeader, Gap, JournalFault};
use umi_protocol::head::{Head, HeadAnswer};
use umi_protocol::message::{JournalInfo, Record};

use super::{HEAD, Stretch, faulty, gone, hidden};
use crate::board::link::{Client, JournalChain, JournalEntry};
use crate::problem::Problem;

/// How long a head is waited for: a board signs when nothing is under way.
pub const PATIENCE: Duration = Duration::from_secs(5);

/// From one question for the head to the next.
const INTERVAL: Duration = Duration::from_millis(20);

/// Heads that are asked for while the board overwrites faster than it can be read.
const TRIES: u32 = 5;

/// What happens while a journal is pulled, in this order.
#[derive(Debug)]
pub enum PullStep<'a> {
    /// What a file begins with as far as that is known, and the entry after the last one to come
    /// but for a head.
    Header(FileHeader, u64),
    /// Entries that the board has overwritten before they could be read.
    Gap(Gap),
    /// An entry whose check value and chain are right, as it is stored.
    Entry(Entry<'a>, &'a [u8]),
}

/// What of a journal has been pulled already.
#[derive(Clone, Copy, Debug)]
pub struct Begun {
    /// What the file begins with.
    pub header: FileHeader,
    /// The entry that is wanted next.
    pub next: u64,
    /// Chain value before it.
    pub chain: Chain,
}

/// A journal that was pulled.
#[derive(Clone, Debug)]
pub struct Pulled {
    /// What it holds.
    pub stretch: Stretch,
    /// What its file begins with, now that its end is known.
    pub header: FileHeader,
    /// The head that it ends with, if one was wanted; none: see `unsigned`.
    pub head: Option<Head>,
    /// Why there is no head where one was wanted.
    pub unsigned: Option<Unsigned>,
}

/// Why a journal has no head at its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unsigned {
    /// The board has no key.
    NoKey,
    /// Something was under way for longer than it was waited.
    Busy,
    /// The same of a board that keeps evidence until somebody acknowledges it: it may have no room for a head.
    Full,
    /// The board overwrote entries while it was pulled, and no head stands between them and those
    /// that were read before.
    Overtaken,
}

impl Unsigned {
    /// A stable name for machines.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::NoKey => "no_board_key",
            Self::Busy => "board_busy",
            Self::Full => "journal_full",
            Self::Overtaken => "overtaken",
        }
    }
}

/// 32 bytes that nobody can have known before.
///
/// # Errors
/// The operating system gives none.
pub fn nonce() -> Result<[u8; 32], Problem> {
    let mut nonce = [0; 32];
    getrandom::fill(&mut nonce).map_err(|error| {
        Problem::trouble(
            "entropy",
            format_args!("no random numbers from the system: {error}"),
        )
    })?;
    Ok(nonce)
}

/// The board's head over a nonce.
///
/// # Errors
/// The link's; `head_signature`: the board's signature is wrong, or over another nonce.
pub fn head(
    board: &mut Client,
    nonce: [u8; 32],
    patience: Duration,
) -> Result<Result<Head, Unsigned>, Problem> {
    let until = Instant::now() + patience;
    loop {
        match board.head(Some(nonce))? {
            HeadAnswer::NoKey => return Ok(Err(Unsigned::NoKey)),
            HeadAnswer::Signed(head) => {
                if head.nonce != Some(nonce) || !umi_core::trust::board_key::is_signed(&head) {
                    let message = "the board's head is not signed by the key that it names: this is not the board that it says it is";
                    return Err(Problem::refused("head_signature", message).with("seq", head.seq));
                }
                return Ok(Ok(head));
            }
            HeadAnswer::Pending if Instant::now() >= until => {
                return Ok(Err(match board.holds_evidence() {
                    true => Unsigned::Full,
                    false => Unsigned::Busy,
                }));
            }
            HeadAnswer::Pending => std::thread::sleep(INTERVAL),
        }
    }
}

/// What is to be pulled.
#[derive(Clone, Copy, Debug, Default)]
pub struct PullRequest {
    /// From this entry on; none: from the oldest.
    pub from: Option<u64>,
    /// What an earlier pull has brought; then `from` says nothing.
    pub begun: Option<Begun>,
    /// A head over a new nonce at the end.
    pub head: bool,
}

/// Pulls all entries that are there when it begins, and the head behind them if one is wanted.
///
/// # Errors
/// The link's; `out_of_range`; an entry that is damaged, missing or does not follow
/// from those before it, by the code of its [`JournalFault`]; `head_signature`; `other_journal`:
/// what was pulled before is not of this board; what `step` returns.
pub fn pull<E: From<Problem>>(
    board: &mut Client,
    wanted: PullRequest,
    mut step: impl FnMut(PullStep<'_>) -> Result<(), E>,
) -> Result<Pulled, E> {
    let info = board.journal_info().map_err(Problem::from)?;
    let (mut header, mut walk) = begin(board, wanted, info)?;
    step(PullStep::Header(header, info.next_seq))?;
    walk.to(board, info.next_seq, &mut step)?;
    let (mut signed, mut unsigned) = (None, None);
    for _ in 0..if wanted.head { TRIES } else { 0 } {
        match head(board, nonce()?, PATIENCE)? {
            Err(why) => unsigned = Some(why),
            Ok(head) => {
                walk.to(board, head.seq.saturating_add(1), &mut step)?;
                // What was overwritten is vouched for by a head that was signed behind that.
                let is_behind = walk
                    .overwritten
                    .last()
                    .is_none_or(|gap| gap.1 <= head.first_seq);
                if !is_behind || walk.seq != head.seq.saturating_add(1) {
                    unsigned = Some(Unsigned::Busy);
                    continue;
                }
                header.nonce = head.nonce;
                (signed, unsigned) = (Some(head), None);
            }
        }
        break;
    }
    walk.tell(&mut step)?;
    // The entries follow from each other; this says that they are the board's, unless it has
    // overwritten them all since.
    if chain_before(board, walk.seq)?.is_ok_and(|chain| chain != walk.chain) {
        return Err(faulty(&JournalFault::ChainBroken { seq: walk.seq }).into());
    }
    if let Some(head) = &signed {
        // Evidence has a chain of its own, which the head names from its oldest piece on.
        let proven_from = head.evidence.map_or(u64::MAX, |mark| mark.first_seq);
        if walk.is_unproven || walk.lonely.is_some_and(|seq| seq < proven_from) {
            unsigned = Some(Unsigned::Overtaken);
        }
    }
    Ok(Pulled {
        stretch: Stretch {
            first: header.first_seq,
            next: walk.seq,
            chain: walk.chain,
            overwritten: walk.overwritten,
        },
        header,
        head: signed,
        unsigned,
    })
}

/// Where the pull begins, and what its file begins with.
fn begin(
    board: &mut Client,
    wanted: PullRequest,
    info: JournalInfo,
) -> Result<(FileHeader, Walk), Problem> {
    if let Some(Begun {
        header,
        next,
        chain,
    }) = wanted.begun
    {
        let is_other = next > info.next_seq
            || chain_before(board, next)?.is_ok_and(|of_board| of_board != chain);
        if is_other {
            let message = "what was pulled before is not of this board's journal: give another name, or take it away";
            return Err(Problem::refused("other_journal", message).with("seq", next));
        }
        // Whether a head stands right before it is not known here: a file is verified as a whole.
        return Ok((header, Walk::new(next, chain, wanted.head)));
    }
    let first = wanted.from.unwrap_or(info.first_seq);
    if !(info.first_seq..=info.next_seq).contains(&first) {
        return Err(gone(first, info));
    }
    let chain = match chain_before(board, first) {
        Ok(chain) => chain.map_err(|info| gone(first, info))?,
        Err(problem) if problem.code == "chain_broken" => {
            return Err(with_way_on(board, problem, first));
        }
        Err(problem) => return Err(problem),
    };
    let header = FileHeader {
        first_seq: first,
        chain_before: chain,
        nonce: None,
    };
    Ok((header, Walk::new(first, chain, wanted.head)))
}

/// Where the pull is.
struct Walk {
    seq: u64,
    chain: Chain,
    overwritten: Vec<(u64, u64)>,
    /// A gap that is not told yet: what follows it may be overwritten, too, before it is read, and
    /// a file has no gap right behind a gap.
    open_gap: Option<Gap>,
    /// The file is to be the board's word.
    is_to_be_signed: bool,
    /// Entries with no head behind them yet. If some behind them are overwritten, no head will
    /// vouch for them: what of them is no evidence goes with those.
    held: Vec<HeldEntry>,
    /// Some were told without a head, because there were too many.
    is_bare: bool,
    /// Some of those stand before what was overwritten.
    is_unproven: bool,
    /// The first piece of evidence that stands before what was overwritten, with no head between.
    lonely: Option<u64>,
}

/// Entries that wait for a head, at most.
const MOST_HELD: usize = 20_000;

/// An entry that was read and is not told yet.
struct HeldEntry {
    seq: u64,
    before: Chain,
    behind: Chain,
    kind: u8,
    raw: Vec<u8>,
}

impl HeldEntry {
    fn tell<E: From<Problem>>(
        &self,
        step: &mut impl FnMut(PullStep<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        let entry = EntryIter::new(&self.raw, self.seq, self.before).next();
        let seq = self.seq;
        let entry = entry.unwrap_or(Err(JournalFault::CutShort { seq }));
        let entry = entry.map_err(|fault| faulty(&fault))?;
        step(PullStep::Entry(entry, &self.raw))
    }
}

impl Walk {
    fn new(seq: u64, chain: Chain, is_to_be_signed: bool) -> Self {
        Self {
            seq,
            chain,
            overwritten: Vec::new(),
            open_gap: None,
            is_to_be_signed,
            held: Vec::new(),
            is_bare: false,
            is_unproven: false,
            lonely: None,
        }
    }

    /// Reads up to entry `end`, or to where the board still has entries behind it.
    fn to<E: From<Problem>>(
        &mut self,
        board: &mut Client,
        end: u64,
        step: &mut impl FnMut(PullStep<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        while self.seq < end {
            match board.journal_read(self.seq).map_err(Problem::from)? {
                JournalEntry::Stored(raw) => {
                    let (seq, before) = (self.seq, self.chain);
                    let kind = match self.entry(&raw) {
                        Ok(entry) => entry.kind,
                        Err(problem) => return Err(with_way_on(board, problem, seq).into()),
                    };
                    self.held.push(HeldEntry {
                        seq,
                        before,
                        behind: self.chain,
                        kind,
                        raw,
                    });
                    let waits = self.is_to_be_signed && self.held.len() < MOST_HELD;
                    if kind == HEAD || !waits {
                        self.tell(step)?;
                        self.is_bare = kind != HEAD;
                    }
                }
                JournalEntry::None(info) => {
                    let gap = self.gap(board, info)?;
                    self.pass_gap(gap, step)?;
                }
            }
        }
        Ok(())
    }

    /// Tells what is held.
    fn tell<E: From<Problem>>(
        &mut self,
        step: &mut impl FnMut(PullStep<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        self.close_gap(step)?;
        self.held.drain(..).try_for_each(|held| held.tell(step))
    }

    /// Takes up a gap, and tells of what stands before it without a head the evidence.
    fn pass_gap<E: From<Problem>>(
        &mut self,
        gap: Gap,
        step: &mut impl FnMut(PullStep<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        self.is_unproven |= std::mem::take(&mut self.is_bare);
        for held in std::mem::take(&mut self.held) {
            // What is nobody's word anyhow is told as it came.
            if Record::is_evidence(held.kind) || !self.is_to_be_signed {
                self.lonely.get_or_insert(held.seq);
                self.close_gap(step)?;
                held.tell(step)?;
            } else {
                self.open_gap(Gap {
                    first: held.seq,
                    next: held.seq + 1,
                    chain_before: held.behind,
                });
            }
        }
        self.open_gap(gap);
        Ok(())
    }

    /// What is missing, in one piece with what is missing right before it.
    fn open_gap(&mut self, gap: Gap) {
        let first = self.open_gap.map_or(gap.first, |before| before.first);
        self.open_gap = Some(Gap { first, ..gap });
    }

    fn close_gap<E: From<Problem>>(
        &mut self,
        step: &mut impl FnMut(PullStep<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some(gap) = self.open_gap.take() {
            self.overwritten.push((gap.first, gap.next));
            step(PullStep::Gap(gap))?;
        }
        Ok(())
    }

    fn entry<'a>(&mut self, raw: &'a [u8]) -> Result<Entry<'a>, Problem> {
        let seq = self.seq;
        let mut entries = EntryIter::new(raw, seq, self.chain);
        // The board shows nothing of what it cannot read itself.
        let entry = entries.next().unwrap_or(Err(JournalFault::Damaged { seq }));
        let entry = entry.map_err(|fault| faulty(&fault))?;
        if entries.offset() != raw.len() {
            return Err(faulty(&JournalFault::Damaged { seq }));
        }
        self.chain = entries.chain_head();
        self.seq = seq + 1;
        Ok(entry)
    }

    /// Passes what the board does not hold any more.
    fn gap(&mut self, board: &mut Client, mut info: JournalInfo) -> Result<Gap, Problem> {
        let first = self.seq;
        loop {
            let next = info.first_seq;
            if next <= first {
                return Err(gone(first, info));
            }
            // It may be overwritten, too, before its chain value is there.
            match chain_before(board, next)? {
                Ok(chain) => {
                    self.seq = next;
                    self.chain = chain;
                    return Ok(Gap {
                        first,
                        next,
                        chain_before: chain,
                    });
                }
                Err(later) if later.first_seq > next => info = later,
                Err(info) => return Err(gone(next, info)),
            }
        }
    }
}

/// With where the board's journal can be read again behind damage in front of `seq` or in it.
fn with_way_on(board: &mut Client, problem: Problem, seq: u64) -> Problem {
    let Ok(info) = board.journal_info() else {
        return problem;
    };
    // The chain value is hidden from the damage to the end of its sector.
    let (mut hidden, mut there) = (seq, info.next_seq);
    while hidden + 1 < there {
        let middle = hidden + (there - hidden) / 2;
        match board.journal_chain(middle) {
            Ok(JournalChain::Before(_)) => there = middle,
            Ok(_) => hidden = middle,
            Err(_) => return problem,
        }
    }
    let message = if there < info.next_seq {
        format!("{problem}; the board has what stands behind it: pull it with --from {there}")
    } else {
        format!("{problem}; nothing behind it can be proven yet")
    };
    Problem { message, ..problem }.with("readable_from", there)
}

/// The board's chain value before an entry; or what there is, if that is not there any more.
fn chain_before(board: &mut Client, seq: u64) -> Result<Result<Chain, JournalInfo>, Problem> {
    match board.journal_chain(seq)? {
        JournalChain::Before(value) => Ok(Ok(Chain(value))),
        JournalChain::Hidden => Err(hidden(seq)),
        JournalChain::None(info) => Ok(Err(info)),
    }
}
