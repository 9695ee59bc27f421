//! Any geometry, any sizes, any order of calls; and any bytes as flash or file.

use proptest::prelude::*;

use super::*;

fn geometries() -> impl Strategy<Value = Geometry> {
    (2..7_u16, 0..9_u32, 0..4_u32, 1..9_u32).prop_filter_map(
        "a sector that holds a header and an entry",
        |(sectors, write_log2, page_log2, pages)| {
            let write_size = 1 << write_log2;
            let page_size = write_size << page_log2;
            let sector_size = page_size.max(256) * pages;
            let geometry = Geometry {
                sectors,
                sector_size,
                write_size,
                page_size,
            };
            Layout::new(geometry).is_ok().then_some(geometry)
        },
    )
}

#[derive(Clone, Debug)]
enum Call {
    Append { len: usize, fill: u8 },
    Prepare(u32),
    Reopen,
    Read(u64),
    Verify,
}

fn calls() -> impl Strategy<Value = Vec<Call>> {
    let call = prop_oneof![
        8 => (0..100_usize, any::<u8>()).prop_map(|(len, fill)| Call::Append { len, fill }),
        2 => (0..=MAX_PAYLOAD, any::<u8>()).prop_map(|(len, fill)| Call::Append { len, fill }),
        1 => (0..2000_u32).prop_map(Call::Prepare),
        1 => Just(Call::Reopen),
        2 => any::<u64>().prop_map(Call::Read),
        1 => Just(Call::Verify),
    ];
    prop::collection::vec(call, 1..120)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Against the simplest model there is: a list.
    #[test]
    fn behaves_as_a_list(geometry in geometries(), calls in calls()) {
        let mut journal = journal(geometry);
        let mut list: Vec<Vec<u8>> = Vec::new();
        let mut buffer = [0; MAX_PAYLOAD];
        for call in calls {
            match call {
                Call::Append { len, fill } => {
                    let payload = std::vec![fill; len.min(journal.max_payload())];
                    let t = Micros(list.len() as u64);
                    prop_assert_eq!(journal.append(fill, t, &payload), Ok(list.len() as u64));
                    list.push(payload);
                }
                Call::Prepare(min_free) => {
                    journal.prepare(min_free).unwrap();
                }
                Call::Reopen => {
                    let (opened, recovery) = reopen(journal);
                    journal = opened;
                    prop_assert!(recovery.is_clean());
                }
                Call::Read(any) => {
                    let (first, next) = (journal.first_seq(), journal.next_seq());
                    if first < next {
                        let seq = first + any % (next - first);
                        let read = journal.read(seq, &mut buffer).unwrap();
                        prop_assert!(read.chained);
                        prop_assert_eq!(read.entry.payload, &list[seq as usize]);
                        prop_assert_eq!(read.entry.t, Micros(seq));
                    }
                }
                Call::Verify => {
                    journal.verify(journal.first_seq(), journal.next_seq()).unwrap();
                }
            }
            prop_assert_eq!(journal.next_seq(), list.len() as u64);
        }
    }

    /// A flash that was hit in many places: never a panic, never a false entry,
    /// never a program over what is not erased (the mock would panic).
    #[test]
    fn survives_any_damage(
        hits in prop::collection::vec((0..4096_usize, any::<u8>()), 1..60),
        entries in 1..200_u64,
    ) {
        let mut journal = journal(GEOMETRY);
        fill(&mut journal, entries);
        let mut flash = journal.into_flash();
        for (at, value) in hits {
            flash.data[at] = value;
        }
        let Ok((mut journal, _)) = Journal::open(flash) else { return Ok(()) };
        prop_assert!(journal.next_seq() <= entries);
        let mut buffer = [0; MAX_PAYLOAD];
        for seq in journal.first_seq()..journal.next_seq() {
            if let Ok(read) = journal.read(seq, &mut buffer) {
                assert_content(&read, seq);
            }
        }
        let end = journal.next_seq();
        fill(&mut journal, 30);
        let (mut journal, _) = reopen(journal);
        prop_assert_eq!(journal.next_seq(), end + 30);
        journal.verify(end.max(journal.first_seq()), end + 30).unwrap();
    }

    /// Any bytes at all as a file or a flash.
    #[test]
    fn reads_nothing_from_noise(noise in prop::collection::vec(any::<u8>(), 4096)) {
        prop_assert!(decode_file(&noise).is_err());
        let mut entries = EntryIter::new(&noise, 0, Chain::GENESIS);
        prop_assert!(entries.next().unwrap().is_err());
        let mut flash = MockFlash::new(GEOMETRY);
        flash.data.copy_from_slice(&noise);
        prop_assert!(Journal::open(flash).is_err());
    }
}
