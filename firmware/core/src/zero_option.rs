//! Room for one value, empty or not: an `Option` whose empty state is all zeros.
//!
//! # Design
//!
//! A board keeps its whole state in a static. The compiler marks the `None` of an
//! [`Option`] with a value that the content never has, which is rarely zero: one such
//! byte, and the static, all of it, stands in flash as well and is copied at start. A
//! vector says by its length that it is empty.

use heapless::Vec;

/// Room for one value.
#[derive(Clone, Debug)]
pub struct ZeroOption<T>(Vec<T, 1>);

impl<T> ZeroOption<T> {
    /// Nothing is there.
    #[must_use]
    pub const fn empty() -> Self {
        Self(Vec::new())
    }

    /// Puts a value there, in place of what was.
    pub fn put(&mut self, value: T) {
        self.0.clear();
        // There is room for one.
        let _ = self.0.push(value);
    }

    /// Takes the value away.
    pub fn take(&mut self) -> Option<T> {
        self.0.pop()
    }

    /// Drops the value.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Whether a value is there.
    #[must_use]
    pub fn is_some(&self) -> bool {
        !self.0.is_empty()
    }

    /// The value.
    #[must_use]
    pub fn get(&self) -> Option<&T> {
        self.0.first()
    }

    /// The value, to change it.
    pub fn get_mut(&mut self) -> Option<&mut T> {
        self.0.first_mut()
    }
}

#[cfg(test)]
mod tests {
    use super::ZeroOption;

    /// A place holds one value, the one that was put there last.
    #[test]
    fn holds_the_latest() {
        let mut place = ZeroOption::empty();
        assert!(!place.is_some() && place.get().is_none());
        place.put(1);
        place.put(2);
        assert_eq!(place.get(), Some(&2));
        assert_eq!(place.take(), Some(2));
        assert_eq!(place.take(), None);
    }
}
