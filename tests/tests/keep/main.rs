//! What is kept stays: the journal through every power cut, storage that does not open.

mod evidence;
mod heads;
mod journal_power_cut;
mod sessions;
mod soak;
mod storage;
mod wear;
