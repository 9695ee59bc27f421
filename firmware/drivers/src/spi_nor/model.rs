//! A model of a W25Q, as its data sheet describes it (Winbond W25Q128JV, rev. F,
//! chapters 8 and 9): for tests only.
//!
//! It ignores what the chip ignores: commands while busy, programs without the
//! latch, writes to protected cells; and a program wraps at the end of its page.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::vec::Vec;

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorKind, ErrorType, Operation, SpiDevice};

const SECTOR: u32 = 4_096;

/// The chip; clones are the same one.
#[derive(Clone, Debug)]
pub struct Chip(Rc<RefCell<State>>);

#[derive(Debug)]
pub struct State {
    pub id: [u8; 3],
    pub unique_id: [u8; 8],
    /// BP0 to BP3, as they stand in the status register.
    pub protection: u8,
    /// The WP line keeps the latch from being set.
    pub never_enabled: bool,
    /// Programs and erases never end.
    pub stuck: bool,
    /// What nothing drives: the line reads as this.
    pub absent: Option<u8>,
    /// The bus reports an error.
    pub bus_fails: bool,
    pub asleep: bool,
    pub program_us: u64,
    pub erase_us: u64,
    /// Power is cut in the middle of this program or erase, counted from 0.
    pub cut_at: Option<usize>,
    /// The sectors that are not erased.
    sectors: BTreeMap<u32, Vec<u8>>,
    enabled: bool,
    busy_until_us: u64,
    now_us: u64,
    /// Commands of programs and erases that were carried out, with their addresses.
    pub done: Vec<(u8, u32)>,
    /// Commands that came while the chip was busy and were ignored.
    pub ignored: usize,
}

impl Chip {
    pub fn new() -> Self {
        Self(Rc::new(RefCell::new(State {
            id: [0xEF, 0x40, 0x18],
            unique_id: [0xD2, 0x66, 0x14, 0x20, 0x5B, 0x3A, 0x11, 0x27],
            protection: 0,
            never_enabled: false,
            stuck: false,
            absent: None,
            bus_fails: false,
            asleep: false,
            program_us: 700,
            erase_us: 45_000,
            cut_at: None,
            sectors: BTreeMap::new(),
            enabled: false,
            busy_until_us: 0,
            now_us: 0,
            done: Vec::new(),
            ignored: 0,
        })))
    }

    pub fn with<R>(&self, change: impl FnOnce(&mut State) -> R) -> R {
        change(&mut self.0.borrow_mut())
    }

    /// Power comes again; what was being done is not continued.
    pub fn power_up(&self) {
        self.with(|state| {
            state.absent = None;
            state.cut_at = None;
            state.enabled = false;
            state.busy_until_us = state.now_us;
            state.done.clear();
        });
    }
}

impl State {
    /// It is busy from now on, as behind an erase that a reset of the processor
    /// has not ended.
    pub fn busy_for_us(&mut self, us: u64) {
        self.busy_until_us = self.now_us + us;
    }

    pub fn now_us(&self) -> u64 {
        self.now_us
    }

    fn capacity(&self) -> u32 {
        1 << self.id[2]
    }

    fn byte(&self, addr: u32) -> u8 {
        let sector = self.sectors.get(&(addr / SECTOR));
        sector.map_or(0xFF, |bytes| bytes[(addr % SECTOR) as usize])
    }

    fn clear_bits(&mut self, addr: u32, value: u8) {
        let sector = self.sectors.entry(addr / SECTOR);
        let bytes = sector.or_insert_with(|| std::vec![0xFF; SECTOR as usize]);
        bytes[(addr % SECTOR) as usize] &= value;
    }

    fn status(&self) -> u8 {
        u8::from(self.now_us < self.busy_until_us)
            | u8::from(self.enabled) << 1
            | self.protection & 0b0011_1100
    }

    /// What the chip answers, byte for byte, before its select line goes high.
    fn answer(&self, sent: &[u8]) -> u8 {
        let at = sent.len() - 1;
        let busy = self.now_us < self.busy_until_us;
        match (sent[0], at) {
            (0x05, 1..) if !self.asleep => self.status(),
            _ if busy || self.asleep => 0xFF,
            (0x9F, 1..=3) => self.id[at - 1],
            (0x4B, 5..=12) => self.unique_id[at - 5],
            (0x03, 4..) => {
                let addr = address(sent) + at as u32 - 4;
                self.byte(addr % self.capacity())
            }
            _ => 0xFF,
        }
    }

    /// What it does when the select line goes high.
    fn act(&mut self, sent: &[u8]) {
        let Some(command) = sent.first().copied() else {
            return;
        };
        if self.asleep {
            self.asleep = command != 0xAB;
            return;
        }
        if self.now_us < self.busy_until_us {
            self.ignored += usize::from(command != 0x05);
            return;
        }
        match (command, sent.len()) {
            (0x06, 1) => self.enabled = !self.never_enabled,
            (0x02, 5..) => {
                let program_us = self.program_us;
                self.write(command, address(sent), program_us, |state, cut| {
                    let bytes = &sent[4..];
                    let whole = if cut { bytes.len() / 2 } else { bytes.len() };
                    let page = address(sent) & !0xFF;
                    for (n, byte) in bytes.iter().take(whole).enumerate() {
                        let place = page + (address(sent) + n as u32) % 256;
                        state.clear_bits(place % state.capacity(), *byte);
                    }
                });
            }
            (0x20 | 0x52 | 0xD8, 4) => {
                let sectors = match command {
                    0x20 => 1,
                    0x52 => 8,
                    _ => 16,
                };
                let first = address(sent) / SECTOR / sectors * sectors;
                let erase_us = self.erase_us;
                self.write(command, address(sent), erase_us, |state, cut| {
                    let whole = if cut { sectors / 2 } else { sectors };
                    for sector in first..first + whole {
                        state.sectors.remove(&sector);
                    }
                    if cut && let Some(bytes) = state.sectors.get_mut(&(first + whole)) {
                        bytes[..SECTOR as usize / 2].fill(0xFF);
                    }
                });
            }
            _ => {}
        }
    }

    fn write(&mut self, command: u8, addr: u32, us: u64, work: impl FnOnce(&mut Self, bool)) {
        if !self.enabled || self.protection != 0 {
            return;
        }
        let cut = self.cut_at == Some(self.done.len());
        self.done.push((command, addr));
        work(self, cut);
        if cut {
            self.absent = Some(0xFF);
        }
        self.busy_until_us = if self.stuck {
            u64::MAX
        } else {
            self.now_us + us
        };
        self.enabled = false;
    }
}

fn address(sent: &[u8]) -> u32 {
    u32::from_be_bytes([0, sent[1], sent[2], sent[3]])
}

impl ErrorType for Chip {
    type Error = ErrorKind;
}

impl SpiDevice for Chip {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        let mut state = self.0.borrow_mut();
        if state.bus_fails {
            return Err(ErrorKind::ModeFault);
        }
        let mut sent = Vec::new();
        for operation in operations {
            match operation {
                Operation::Write(bytes) => sent.extend_from_slice(bytes),
                Operation::Read(bytes) => {
                    for byte in bytes.iter_mut() {
                        sent.push(0);
                        *byte = state.absent.unwrap_or_else(|| state.answer(&sent));
                    }
                }
                other => panic!("not used by the driver: {other:?}"),
            }
        }
        if state.absent.is_none() {
            state.act(&sent);
        }
        // A microsecond a byte: 8 MHz.
        state.now_us += sent.len() as u64;
        Ok(())
    }
}

impl DelayNs for Chip {
    fn delay_ns(&mut self, ns: u32) {
        self.with(|state| state.now_us += u64::from(ns.div_ceil(1_000)));
    }
}
