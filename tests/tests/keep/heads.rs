//! Signed heads: when a board signs, and that a pull ends with a head whatever the line does
//! meanwhile.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use umi_app::measure::trust::heads::{MOST_ENTRIES, QUIET_US};
use umi_client::board::link::Client;
use umi_client::journal::verify::verify;
use umi_client::journal::{self, PullRequest, PullStep, Pulled};
use umi_client::problem::Problem;
use umi_core::journal::Geometry;
use umi_core::units::Micros;
use umi_protocol::head::{Head, HeadAnswer};
use umi_protocol::message::Record;
use umi_tests::cases::{clamping, job};
use umi_virtual::board::KEY;
use umi_virtual::{BoardTime, Config, VirtualBoard, VirtualFlash};

fn config() -> Config {
    Config {
        key: Some(VirtualFlash::in_memory(KEY)),
        ..Config::default()
    }
}

fn start(config: Config) -> (VirtualBoard, Client) {
    let board = VirtualBoard::start(config).unwrap();
    let client = umi_desk::client(&board).unwrap();
    (board, client)
}

/// Time passes; then everything that is due is done.
fn pass(board: &VirtualBoard, us: u64) {
    board.advance(Micros(board.now().0 + us));
    std::thread::sleep(Duration::from_millis(20));
}

/// Waits until the board has come to so many verdicts.
fn judged(client: &mut Client, verdicts: u32) {
    let begun = Instant::now();
    while client.status().unwrap().verdicts < verdicts {
        assert!(begun.elapsed() < Duration::from_secs(10));
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn signed(client: &mut Client, nonce: Option<[u8; 32]>) -> Option<Head> {
    match client.head(nonce).unwrap() {
        HeadAnswer::Signed(head) => Some(head),
        HeadAnswer::Pending => None,
        HeadAnswer::NoKey => panic!("a board with a key says that it has none"),
    }
}

/// The file of a whole pull, whose reader is away for a while at its first entry.
fn pulled(client: &mut Client, mut away: Duration) -> (Vec<u8>, Pulled) {
    let mut items = Vec::new();
    let wanted = PullRequest {
        head: true,
        ..PullRequest::default()
    };
    let pulled = journal::pull(client, wanted, |step| {
        match step {
            PullStep::Header(..) => {}
            PullStep::Gap(gap) => items.extend(gap.encode()),
            PullStep::Entry(_, raw) => {
                items.extend(raw);
                std::thread::sleep(std::mem::take(&mut away));
            }
        }
        Ok::<_, Problem>(())
    })
    .unwrap();
    ([&pulled.header.encode()[..], &items].concat(), pulled)
}

/// A start and a verdict have a head behind them as soon as nothing waits for the board: never
/// while a clamping is under way, and unasked never while a correction may be read.
#[test]
fn a_head_waits_for_everything_else() {
    let (board, mut client) = start(config());
    client.set_job(&job()).unwrap().unwrap();
    pass(&board, QUIET_US - 1);
    assert_eq!(signed(&mut client, None), None);
    pass(&board, 1);
    let first = signed(&mut client, None).unwrap();
    assert_eq!((first.boot, first.nonce), (1, None));
    assert!(first.seq >= 2, "{first:?}");

    let text = clamping(0);
    let (begin, end) = text.split_at(text.len() / 2);
    let asked = Some([7; 32]);
    board.control_sends(begin.as_bytes());
    for _ in 0..5 {
        pass(&board, QUIET_US);
        assert_eq!(signed(&mut client, asked), None);
    }
    board.control_sends(end.as_bytes());
    judged(&mut client, 1);
    pass(&board, QUIET_US);
    let second = signed(&mut client, asked).unwrap();
    assert!(second.seq > first.seq);

    // The first clamping taught, the next has a correction that the control may read.
    board.control_sends(clamping(1).as_bytes());
    judged(&mut client, 2);
    assert!(client.status().unwrap().correction_waiting);
    pass(&board, 3 * QUIET_US);
    assert_eq!(signed(&mut client, None), Some(second.clone()));
    board.control_sends(&[0x11]);
    while board.control_receives(Duration::from_millis(100)).is_some() {}
    pass(&board, 2 * QUIET_US);
    let third = signed(&mut client, None).unwrap();
    assert!(third.seq > second.seq, "{third:?}");
}

/// A line that is never quiet does not keep the board from signing.
#[test]
fn noise_does_not_outrun_the_heads() {
    let (board, mut client) = start(config());
    for _ in 0..6_000 {
        board.control_sends(b"x\n");
        pass_quickly(&board);
    }
    let (file, _) = pulled_later(&board, &mut client);
    let mut since = 0;
    journal::read::<Problem>(&file, |item| {
        if let journal::FileItem::Entry(entry) = item {
            since += 1;
            if let Record::Head(_) = journal::record(&entry).unwrap() {
                since = 0;
            }
            // A piece that came while it signed.
            assert!(since <= MOST_ENTRIES + 2, "entry {}", entry.seq);
        }
        Ok(())
    })
    .unwrap();
    assert!(verify(&file, None, None).unwrap().signed);
}

/// A millisecond, with a moment for the board.
fn pass_quickly(board: &VirtualBoard) {
    board.advance(Micros(board.now().0 + 1000));
    std::thread::yield_now();
}

/// A pull of a board whose time somebody must move on for it.
fn pulled_later(board: &VirtualBoard, client: &mut Client) -> (Vec<u8>, Pulled) {
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                pass(board, 100_000);
            }
        });
        let found = pulled(client, Duration::ZERO);
        done.store(true, Ordering::Relaxed);
        found
    })
}

/// Says that it is done when it goes.
struct Finally<'a>(&'a AtomicBool);

impl Drop for Finally<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// A board that overwrites its journal while it is pulled: the pull goes on, names what was
/// overwritten, and ends with a head; nobody can say that of entries that the board still had.
#[test]
fn a_pull_that_is_overtaken_goes_on() {
    let small = Geometry {
        sectors: 4,
        sector_size: 16_384,
        write_size: 1,
        page_size: 256,
    };
    let (board, mut client) = start(Config {
        time: BoardTime::Real,
        journal: VirtualFlash::in_memory(small),
        ..config()
    });
    let done = AtomicBool::new(false);
    let mut overwritten = 0;
    std::thread::scope(|scope| {
        // Also where something below fails: the line would be noisy for ever.
        let _quiet_at_end = Finally(&done);
        scope.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                for _ in 0..4 {
                    board.control_sends(b"noise on the line, noise on the line, noise\n");
                }
                std::thread::sleep(Duration::from_millis(10));
            }
        });
        for _ in 0..3 {
            let (file, pulled) = pulled(&mut client, Duration::from_millis(1500));
            overwritten += pulled.stretch.overwritten.len();
            let verified = verify(&file, None, None).unwrap();
            assert_eq!(verified.stretch, pulled.stretch);
            if pulled.unsigned.is_none() {
                assert!(verified.signed);
            }
        }
    });
    assert!(
        overwritten > 0,
        "nothing was overwritten: the test is too slow to show anything"
    );
    // The line is quiet again.
    let (file, pulled) = pulled(&mut client, Duration::ZERO);
    assert!(pulled.head.is_some());
    assert!(
        verify(&file, pulled.head.map(|head| head.key), None)
            .unwrap()
            .signed
    );
}
