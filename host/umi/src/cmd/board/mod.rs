//! A board: what it is, what it is told, what it shows.

pub(super) mod access;
pub(super) mod config;
pub(super) mod info;
pub(super) mod job;
pub(super) mod line;
pub(super) mod selftest;
pub(super) mod teach;
pub(super) mod update;
pub(super) mod virtual_board;
pub(super) mod watch;
pub(super) mod wipe;
