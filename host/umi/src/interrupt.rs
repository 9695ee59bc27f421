//! Turns SIGINT, SIGTERM and SIGHUP into a flag, for a clean end; a terminal that is gone, too.

use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

static CAME: AtomicBool = AtomicBool::new(false);
static WATCHED: AtomicBool = AtomicBool::new(false);

/// From now on an interrupt is noticed instead of ending the process; a second one
/// ends it.
pub fn watch() {
    WATCHED.store(true, Ordering::Relaxed);
    take();
}

/// From now on a process that an interrupt ends leaves no file that is not complete (`NAME.part`).
pub fn leave_nothing_unfinished() {
    take();
}

/// Takes the signals, once. Where the system refuses, an interrupt is as it was.
fn take() {
    static TAKEN: Once = Once::new();
    TAKEN.call_once(|| {
        #[cfg(unix)]
        {
            use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
            // Who ignores the hang-up, as under nohup, goes on ignoring it.
            let hang_up = (!ignores_hang_up()).then_some(SIGHUP);
            let signals = [SIGINT, SIGTERM].into_iter().chain(hang_up);
            if let Ok(mut signals) = signal_hook::iterator::Signals::new(signals) {
                std::thread::spawn(move || signals.forever().for_each(|_| interrupted()));
            }
        }
        #[cfg(not(unix))]
        let _ = ctrlc::set_handler(interrupted);
    });
}

fn interrupted() {
    if !WATCHED.load(Ordering::Relaxed) || CAME.swap(true, Ordering::Relaxed) {
        umi_scan::format::remove_unfinished(|| std::process::exit(130));
    }
}

/// Whether the system says so; Linux does.
#[cfg(unix)]
fn ignores_hang_up() -> bool {
    const HANG_UP: u64 = 1;
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask & HANG_UP != 0)
}

/// The longest that work may take to end after a hang-up.
#[cfg(unix)]
const LAST: std::time::Duration = std::time::Duration::from_millis(500);

/// From now on this process ends when the terminal that it reads is gone: who reads keys would
/// read the end of its input for ever. The signal SIGHUP goes only to a terminal's own session.
pub fn end_on_hang_up() {
    #[cfg(unix)]
    if std::io::IsTerminal::is_terminal(&std::io::stdin()) {
        std::thread::spawn(|| {
            if has_hung_up() {
                CAME.store(true, Ordering::Relaxed);
                std::thread::sleep(LAST);
                // What is still at work waits for keys that cannot come.
                std::process::exit(HUNG_UP);
            }
        });
    }
}

/// The exit status of a program that a hang-up ends: 128 and SIGHUP.
#[cfg(unix)]
const HUNG_UP: i32 = 129;

/// Waits for the terminal's end. False: this system does not tell.
#[cfg(unix)]
fn has_hung_up() -> bool {
    use rustix::event::{PollFd, PollFlags, poll};
    use rustix::io::Errno;
    let stdin = std::io::stdin();
    loop {
        let mut fds = [PollFd::new(&stdin, PollFlags::empty())];
        match poll(&mut fds, None) {
            Ok(_) if fds[0].revents().contains(PollFlags::HUP) => return true,
            Err(Errno::INTR) => {}
            _ => return false,
        }
    }
}

/// From now on the end of standard input is noticed as an interrupt is, where it is no
/// terminal: for a command that nothing else could end.
pub fn end_with_input() {
    if !std::io::IsTerminal::is_terminal(&std::io::stdin()) {
        std::thread::spawn(|| {
            // A failure is an end, too.
            let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
            CAME.store(true, Ordering::Relaxed);
        });
    }
}

/// Whether one came.
#[must_use]
pub fn came() -> bool {
    CAME.load(Ordering::Relaxed)
}
