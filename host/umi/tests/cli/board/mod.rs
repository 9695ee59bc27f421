//! Commands that talk to a board, and the job that it is given.

mod access;
mod connected;
mod job;
mod line;
mod owner;
mod selftest;
mod teach;
mod update;
mod watch;
