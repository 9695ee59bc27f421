//! Local and common variables, named parameters.

use std::collections::{BTreeMap, HashMap};

use super::alarm::{Checked, Fault};
use super::settings::ControlFamily;

/// Local variables in Custom Macro B: #1 to #33; LinuxCNC #1 to #30.
pub(crate) const LOCALS: usize = 33;

/// The local variables of one level of call.
#[derive(Clone, Debug)]
pub(crate) struct Level {
    numbered: [Option<f64>; LOCALS],
    named: HashMap<String, f64>,
}

impl Default for Level {
    fn default() -> Self {
        Self {
            numbered: [None; LOCALS],
            named: HashMap::new(),
        }
    }
}

impl Level {
    /// Sets #number.
    pub fn set(&mut self, number: usize, value: Option<f64>) {
        if let Some(slot) = number.checked_sub(1).and_then(|i| self.numbered.get_mut(i)) {
            *slot = value;
        }
    }

    /// How many named parameters it has.
    pub fn names(&self) -> usize {
        self.named.len()
    }
}

/// The variables that programs own.
#[derive(Clone, Debug, Default)]
pub(crate) struct Variables {
    /// Common ones that are not null.
    common: BTreeMap<u32, f64>,
    global: HashMap<String, f64>,
    names: usize,
}

impl Variables {
    /// Whether a number is that of a local variable.
    pub fn is_local(number: u32, dialect: ControlFamily) -> bool {
        match dialect {
            ControlFamily::LinuxCnc => (1..=30).contains(&number),
            _ => (1..=33).contains(&number),
        }
    }

    /// Whether a number is that of a common variable.
    pub fn is_common(number: u32, dialect: ControlFamily) -> bool {
        match dialect {
            ControlFamily::LinuxCnc => (31..=5000).contains(&number),
            ControlFamily::Haas => {
                (100..=199).contains(&number)
                    || (500..=999).contains(&number)
                    || (10_000..=10_999).contains(&number)
            }
            _ => (100..=199).contains(&number) || (500..=999).contains(&number),
        }
    }

    /// A local or common variable; none if the number is neither's.
    pub fn get(&self, level: &Level, number: u32, dialect: ControlFamily) -> Option<Option<f64>> {
        let value = if Self::is_local(number, dialect) {
            let index = usize::try_from(number).ok()?.checked_sub(1)?;
            level.numbered.get(index).copied().flatten()
        } else if Self::is_common(number, dialect) {
            self.common.get(&number).copied()
        } else {
            return None;
        };
        // LinuxCNC has no null: what nobody set is zero.
        Some(match dialect {
            ControlFamily::LinuxCnc => Some(value.unwrap_or(0.0)),
            _ => value,
        })
    }

    /// Sets a local or common variable; false if the number is neither's.
    pub fn set(
        &mut self,
        level: &mut Level,
        number: u32,
        value: Option<f64>,
        dialect: ControlFamily,
    ) -> bool {
        if Self::is_local(number, dialect) {
            level.set(usize::try_from(number).unwrap_or(0), value);
            true
        } else if Self::is_common(number, dialect) {
            match value {
                Some(value) => self.common.insert(number, value),
                None => self.common.remove(&number),
            };
            true
        } else {
            false
        }
    }

    /// A named parameter: global if its name begins with `_`.
    pub fn named(&self, level: &Level, name: &str) -> Option<f64> {
        if name.starts_with('_') {
            self.global.get(name).copied()
        } else {
            level.named.get(name).copied()
        }
    }

    /// Sets a named parameter.
    pub fn set_named(
        &mut self,
        level: &mut Level,
        name: &str,
        value: f64,
        limit: usize,
    ) -> Checked<()> {
        let table = if name.starts_with('_') {
            &mut self.global
        } else {
            &mut level.named
        };
        if let Some(slot) = table.get_mut(name) {
            *slot = value;
            return Ok(());
        }
        if self.names >= limit {
            return Err(Fault::new(format!("more than {limit} named parameters")));
        }
        self.names += 1;
        table.insert(name.to_string(), value);
        Ok(())
    }

    /// A level of call has ended.
    pub fn forget(&mut self, level: &Level) {
        self.names = self.names.saturating_sub(level.names());
    }
}
