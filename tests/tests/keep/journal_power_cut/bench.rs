//! A journal, what must be in it, and every way to cut its power.

use umi_core::journal::{
    Chain, ERASED, Entry, Flash, Geometry, Journal, JournalError, MAX_PAYLOAD, OVERHEAD, Recovery,
    encode_entry,
};
use umi_core::units::Micros;

use super::mock::{Cut, ERASE_CUTS, MockError, MockFlash, Op, Random};

/// What was appended.
#[derive(Clone, Debug)]
pub struct Record {
    kind: u8,
    t: Micros,
    payload: Vec<u8>,
}

impl Record {
    pub fn random(random: &mut Random, max: usize) -> Self {
        // Mostly short, now and then the longest, and bytes that look like flash
        // that is erased or like an entry's marker.
        let len = match random.below(8) {
            0 => random.below(max as u64 + 1) as usize,
            1 => max,
            2 => 0,
            _ => random.below(60.min(max as u64)) as usize,
        };
        let alphabet: &[u8] = match random.below(4) {
            0 => &[0xFF],
            1 => &[0xA5, 0xFF, 0x00],
            2 => b"X-12.3450 Y0.001\r\n",
            _ => &[],
        };
        let payload = (0..len)
            .map(|_| match alphabet {
                [] => random.byte(),
                some => some[random.below(some.len() as u64) as usize],
            })
            .collect();
        Self {
            kind: random.byte(),
            t: Micros(random.bits() >> 20),
            payload,
        }
    }
}

/// The record as it must be: every entry acknowledged, and the chain after each.
#[derive(Clone)]
pub struct Model {
    records: Vec<Record>,
    /// `chains[k]` is the value before entry k.
    chains: Vec<Chain>,
}

impl Model {
    pub fn new() -> Self {
        Self {
            records: Vec::new(),
            chains: vec![Chain::GENESIS],
        }
    }

    fn push(&mut self, record: &Record) {
        let mut chain = self.chains[self.records.len()];
        let entry = Entry {
            seq: self.records.len() as u64,
            t: record.t,
            kind: record.kind,
            payload: &record.payload,
        };
        encode_entry(&entry, &mut chain, &mut [0; MAX_PAYLOAD + OVERHEAD]).unwrap();
        self.chains.push(chain);
        self.records.push(record.clone());
    }

    pub fn next_seq(&self) -> u64 {
        self.records.len() as u64
    }

    /// Every entry that the journal has reads as it was appended; numbers and
    /// chain are those of the model.
    pub fn check(&self, journal: &mut Journal<MockFlash>) {
        assert_eq!(journal.next_seq(), self.next_seq());
        let mut buffer = [0; MAX_PAYLOAD];
        let (first, next) = (journal.first_seq(), journal.next_seq());
        for seq in first..next {
            let read = journal.read(seq, &mut buffer).unwrap();
            let record = &self.records[seq as usize];
            let Record {
                kind,
                t,
                ref payload,
            } = *record;
            assert_eq!(
                read.entry,
                Entry {
                    seq,
                    t,
                    kind,
                    payload
                }
            );
            assert!(read.chained);
        }
        let verified = journal.verify(first, next).unwrap();
        assert_eq!(verified.chain_before, self.chains[first as usize]);
        assert_eq!(verified.chain, self.chains[next as usize]);
        assert_eq!(journal.chain_head(), self.chains[next as usize]);
    }
}

/// One call that changes the flash.
#[derive(Clone, Debug)]
pub enum Step {
    Append(Record),
    Prepare(u32),
}

impl Step {
    fn run(&self, journal: &mut Journal<MockFlash>) -> Result<(), JournalError<MockError>> {
        match self {
            Self::Append(record) => journal
                .append(record.kind, record.t, &record.payload)
                .map(|_| ()),
            Self::Prepare(min_free) => journal.prepare(*min_free).map(|_| ()),
        }
    }

    /// What may be in the journal although it was not acknowledged.
    fn pending(&self) -> Option<&Record> {
        match self {
            Self::Append(record) => Some(record),
            Self::Prepare(_) => None,
        }
    }
}

/// Every way in which power can be cut in one operation.
fn cuts(op: Op, geometry: Geometry) -> Vec<Cut> {
    match op {
        Op::Erase { .. } => ERASE_CUTS.to_vec(),
        Op::Program { addr, len } => {
            let mut cuts: Vec<Cut> = (0..=len).map(Cut::AtByte).collect();
            cuts.extend(
                (0..len)
                    .step_by(geometry.write_size as usize)
                    .map(Cut::Unseen),
            );
            let page = geometry.page_size as usize;
            let next_page = (addr as usize + 1).next_multiple_of(page) - addr as usize;
            let pages = std::iter::once(0).chain((next_page..len).step_by(page));
            // Random bits: a few draws.
            cuts.extend(pages.flat_map(|at| [Cut::Page(at); 3]));
            cuts
        }
    }
}

/// What was done, printed with `--nocapture`.
#[derive(Default, Debug)]
pub struct Figures {
    pub entries: u64,
    pub erases: u64,
    pub operations: u64,
    pub cuts: u64,
    pub second_cuts: u64,
    pub pending_kept: u64,
    pub torn_reported: u64,
    pub unfinished_reported: u64,
    pub programs_over_unseen: u64,
}

/// A journal and what must be in it.
#[derive(Clone)]
pub struct Bench {
    pub journal: Journal<MockFlash>,
    pub model: Model,
    /// Nothing was appended since the last power-up.
    pub just_opened: bool,
    /// What was cut may be programmed again if nothing can be seen of it: a
    /// mark, or the first entry after a power-up.
    pub unseen_is_excused: bool,
}

impl Bench {
    /// Runs `step` to its end; returns the operations it made.
    pub fn run(&mut self, step: &Step) -> Vec<Op> {
        self.journal.flash().take_ops();
        step.run(&mut self.journal).unwrap();
        if let Some(record) = step.pending() {
            self.model.push(record);
            self.just_opened = false;
        }
        self.journal.flash().take_ops()
    }

    /// Runs `step` on a copy and cuts power in one of its operations; opens the
    /// journal again and checks it. `first_after` is the oldest entry that the
    /// whole step would have left.
    pub fn cut(&self, step: &Step, at: &CutAt, first_after: u64, figures: &mut Figures) -> Self {
        let mut journal = self.journal.clone();
        journal.flash().take_ops();
        journal.flash().cut_power_at(at.index, at.cut, at.seed);
        assert_eq!(
            step.run(&mut journal),
            Err(JournalError::Flash(MockError::PowerLost))
        );
        let mut flash = journal.into_flash();
        flash.power_up();
        let cells = flash.data.clone();
        let (mut journal, recovery) = Journal::open(flash).unwrap();
        assert_eq!(journal.flash().take_ops(), [], "opening only reads");
        assert_eq!(journal.flash().data, cells);

        let mut model = self.model.clone();
        if journal.next_seq() == model.next_seq() + 1 {
            model.push(step.pending().expect("nothing was being appended"));
            figures.pending_kept += 1;
        } else {
            at.check_report(journal.flash(), &recovery);
        }
        let first = journal.first_seq();
        assert!((self.journal.first_seq()..=first_after).contains(&first));
        assert_eq!(
            (recovery.first_seq, recovery.next_seq),
            (first, model.next_seq())
        );
        assert_eq!(recovery.damaged_entries, 0);
        assert!(!recovery.chain_restarted);
        model.check(&mut journal);
        figures.torn_reported += u64::from(recovery.torn_bytes > 0);
        figures.unfinished_reported += u64::from(recovery.sector_unfinished);
        let excused = self.unseen_is_excused || self.just_opened || at.is_mark(journal.flash());
        Self {
            journal,
            model,
            just_opened: true,
            unseen_is_excused: excused,
        }
    }

    /// The journal goes on: it takes entries, and keeps them over a power-up.
    pub fn goes_on(mut self, records: &[Record], figures: &mut Figures) {
        for record in records {
            self.run(&Step::Append(record.clone()));
        }
        self.model.check(&mut self.journal);
        let (mut journal, recovery) = Journal::open(self.journal.into_flash()).unwrap();
        assert!(recovery.is_clean());
        self.model.check(&mut journal);
        let unseen = journal.flash().programs_over_unseen;
        assert!(
            unseen == 0 || self.unseen_is_excused,
            "{unseen} programs over torn words"
        );
        figures.programs_over_unseen += u64::from(unseen);
    }
}

/// One way to cut power in one operation of a step.
#[derive(Clone, Copy, Debug)]
pub struct CutAt {
    index: usize,
    op: Op,
    cut: Cut,
    seed: u64,
}

impl CutAt {
    /// Everywhere in these operations.
    pub fn all(ops: &[Op], geometry: Geometry, random: &mut Random) -> Vec<Self> {
        let mut all = Vec::new();
        for (index, op) in ops.iter().enumerate() {
            for cut in cuts(*op, geometry) {
                all.push(Self {
                    index,
                    op: *op,
                    cut,
                    seed: random.bits(),
                });
            }
        }
        all
    }

    /// Offset in a sector of its first entry, behind header and mark.
    fn first_entry(geometry: Geometry) -> u32 {
        64_u32.next_multiple_of(geometry.write_size) + geometry.write_size.max(4)
    }

    /// It is the mark that is programmed.
    fn is_mark(&self, flash: &MockFlash) -> bool {
        let geometry = flash.geometry();
        let Op::Program { addr, .. } = self.op else {
            return false;
        };
        (64..Self::first_entry(geometry)).contains(&(addr % geometry.sector_size))
    }

    /// What can be seen of an entry or an erase that was cut is reported.
    fn check_report(&self, flash: &MockFlash, recovery: &Recovery) {
        let sector_size = flash.geometry().sector_size;
        let first_entry = Self::first_entry(flash.geometry());
        let (range, reported) = match self.op {
            Op::Program { addr, len } if addr % sector_size >= first_entry => {
                (addr as usize..addr as usize + len, recovery.torn_bytes > 0)
            }
            Op::Erase { sector } => {
                let size = sector_size as usize;
                (
                    sector as usize * size..(sector as usize + 1) * size,
                    recovery.sector_unfinished,
                )
            }
            // A header or a mark: nobody has to know of it.
            Op::Program { .. } => return,
        };
        let seen = flash.data[range].iter().any(|byte| *byte != ERASED);
        assert!(
            !seen || reported,
            "what was cut can be seen and is not reported: {self:?}"
        );
    }
}
