//! Whether evidence is missing where the entries between are not there any more.
//!
//! An entry whose successors were overwritten up to some gap is not proven by the chain: who edits
//! a file can make a gap. If it is evidence it is proven by the chain of evidence, which heads name
//! ([`umi_protocol::head::EvidenceMark`]); if it is not, by nothing.

use umi_core::journal::{Chain, Entry, OVERHEAD, encode_entry};
use umi_protocol::head::EvidenceMark;
use umi_protocol::message::Record;

/// A place in the chain of evidence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    number: u64,
    chain: Chain,
}

impl Place {
    /// Moves behind a piece.
    fn pass(&mut self, piece: &Evidence) {
        let entry = Entry {
            seq: self.number,
            t: piece.t,
            kind: piece.kind,
            payload: &piece.payload,
        };
        let mut room = vec![0; piece.payload.len() + OVERHEAD];
        // There is room, and it is no longer than what a board wrote.
        let _ = encode_entry(&entry, &mut self.chain, &mut room);
        self.number += 1;
    }
}

/// A piece of evidence as it stands in its chain.
struct Evidence {
    seq: u64,
    kind: u8,
    t: umi_core::units::Micros,
    payload: Vec<u8>,
}

/// The evidence of a file while it is read.
pub(super) struct EvidenceCheck {
    first_seq: u64,
    /// At the last head; known from the first head on that names it.
    place: Option<Place>,
    /// What came since.
    recent: Vec<Evidence>,
    /// What came before the first head that names the place, and what that said.
    early: Vec<Evidence>,
    reached: Option<(Place, u64)>,
    /// The first mark whose oldest piece is in this file.
    anchor: Option<EvidenceMark>,
    /// The first entry since the last head or gap that is no evidence, and that is.
    bare: Option<u64>,
    pieces_since: Option<u64>,
    /// The first piece before a gap that no head has proven yet.
    cut: Option<u64>,
    /// The first piece of those before the first head that stands before a gap.
    early_cut: Option<u64>,
    /// The first entry that nothing proves.
    unproven: Option<u64>,
    /// The first entry that is missing with no head behind it yet that names evidence.
    missing: Option<u64>,
    /// The same, before the first such head.
    early_missing: Option<u64>,
    /// The board keeps evidence apart, as far as is known: a head without a mark vouches for no gap then.
    is_kept_apart: bool,
    /// Pieces before a head are not all that it names; a later head may say that the board has
    /// overwritten the others since.
    doubt: Option<Doubt>,
}

/// Pieces that are not all that a head names.
struct Doubt {
    /// Of the head.
    seq: u64,
    /// Where the last piece before them stands, and what the head says.
    from: Place,
    said: Place,
    pieces: Vec<Evidence>,
    /// The first of them that stands before a gap: the chain of entries does not prove it.
    cut: Option<u64>,
}

/// The evidence is not that of which the head in entry `seq` says that it was all.
pub(super) struct OtherEvidence {
    pub seq: u64,
}

impl EvidenceCheck {
    /// Of a file that begins with this entry, of a board of which a kept head may say that it keeps evidence apart.
    pub fn new(first_seq: u64, is_kept_apart: bool) -> Self {
        Self {
            first_seq,
            place: None,
            recent: Vec::new(),
            early: Vec::new(),
            reached: None,
            anchor: None,
            bare: None,
            pieces_since: None,
            cut: None,
            early_cut: None,
            unproven: None,
            missing: None,
            early_missing: None,
            is_kept_apart,
            doubt: None,
        }
    }

    /// From this entry on some are missing here.
    pub fn gap(&mut self, first: u64) {
        self.missing.get_or_insert(first);
        self.part();
    }

    /// What came since the last head has none behind it.
    fn part(&mut self) {
        if let Some(seq) = self.bare.take() {
            self.unproven.get_or_insert(seq);
        }
        if let Some(seq) = self.pieces_since.take() {
            self.cut.get_or_insert(seq);
        }
    }

    /// The next entry, which is no head.
    pub fn entry(&mut self, entry: &Entry<'_>, before: &Chain) {
        if !Record::is_evidence(entry.kind) {
            self.bare.get_or_insert(entry.seq);
            return;
        }
        self.pieces_since.get_or_insert(entry.seq);
        self.piece(entry, before);
    }

    fn piece(&mut self, entry: &Entry<'_>, before: &Chain) {
        self.recent.push(Evidence {
            seq: entry.seq,
            kind: entry.kind,
            t: entry.t,
            payload: [&entry.seq.to_le_bytes()[..], &before.0, entry.payload].concat(),
        });
    }

    /// A good head stands here.
    pub fn head(
        &mut self,
        entry: &Entry<'_>,
        before: &Chain,
        mark: Option<&EvidenceMark>,
    ) -> Result<(), OtherEvidence> {
        // What stands before it in one piece is proven by the chain.
        (self.bare, self.pieces_since) = (None, None);
        if let Some(mark) = mark {
            let missing = self.missing.take();
            if self.place.is_none() {
                self.early_missing = missing;
            }
            self.is_kept_apart = true;
            let said = Place {
                number: mark.next,
                chain: Chain(mark.chain),
            };
            let recent = std::mem::take(&mut self.recent);
            self.resolve(mark)?;
            let place = self.place;
            match place {
                Some(place) if !self.is_all(place, &recent, mark, said) => {
                    if let Some(doubt) = &self.doubt {
                        return Err(OtherEvidence { seq: doubt.seq });
                    }
                    self.doubt = Some(Doubt {
                        seq: entry.seq,
                        from: place,
                        said,
                        pieces: recent,
                        cut: self.cut.take(),
                    });
                }
                Some(_) => {}
                None => {
                    self.early_cut = self.cut.take();
                    self.reached = Some((said, entry.seq));
                    self.early = recent;
                }
            }
            self.place = Some(said);
            if self.anchor.is_none() && mark.first_seq >= self.first_seq {
                self.anchor = Some(*mark);
            }
        } else if let Some(seq) = self.cut.take() {
            self.unproven.get_or_insert(seq);
        }
        self.piece(entry, before);
        Ok(())
    }

    /// Whether these are all the pieces between a place and where a head says that it stands. What
    /// the board had overwritten before that head is missing by right: the head says from where on
    /// it still had them.
    fn is_all(
        &mut self,
        place: Place,
        recent: &[Evidence],
        mark: &EvidenceMark,
        said: Place,
    ) -> bool {
        let from = if mark.first > place.number {
            mark.first_seq
        } else {
            0
        };
        let is_all = leads_to(place, recent, mark, said);
        if is_all && let Some(cut) = self.cut.take().filter(|cut| *cut < from) {
            self.unproven.get_or_insert(cut);
        }
        is_all
    }

    /// A later head says what the board had overwritten by then.
    fn resolve(&mut self, mark: &EvidenceMark) -> Result<(), OtherEvidence> {
        let Some(doubt) = self.doubt.take_if(|doubt| mark.first > doubt.from.number) else {
            return Ok(());
        };
        // Where it held nothing any more of what stands before that head, the head alone is proven.
        let is_all =
            mark.first > doubt.said.number || leads_to(doubt.from, &doubt.pieces, mark, doubt.said);
        if !is_all {
            return Err(OtherEvidence { seq: doubt.seq });
        }
        if let Some(cut) = doubt.cut.filter(|cut| *cut < mark.first_seq) {
            self.unproven.get_or_insert(cut);
        }
        Ok(())
    }

    /// The file has ended: the first entry that nothing proves.
    pub fn end(mut self) -> Result<Option<u64>, OtherEvidence> {
        self.part();
        if let Some(doubt) = &self.doubt {
            return Err(OtherEvidence { seq: doubt.seq });
        }
        // Somebody may have taken out what stood there, of a board that would have kept it.
        let missing = self.missing.filter(|_| self.is_kept_apart);
        let mut first = [self.unproven, self.cut, missing]
            .into_iter()
            .flatten()
            .min();
        let Some((reached, seq)) = self.reached else {
            return Ok(first);
        };
        // What came before the first head, from the oldest piece on that a head names.
        let anchor = self.anchor.filter(|mark| mark.next >= mark.first);
        if let Some(mark) = anchor.filter(|mark| mark.first <= reached.number) {
            let mut place = Place {
                number: mark.first,
                chain: Chain(mark.first_chain),
            };
            for piece in self.early.iter().filter(|of| of.seq >= mark.first_seq) {
                place.pass(piece);
            }
            if place != reached {
                return Err(OtherEvidence { seq });
            }
        }
        let proven_from = anchor.map_or(u64::MAX, |mark| mark.first_seq);
        let cut = self.early_cut.filter(|cut| *cut < proven_from);
        let missing = self.early_missing.filter(|_| anchor.is_none());
        first = [first, cut, missing].into_iter().flatten().min();
        Ok(first)
    }
}

/// Whether these pieces lead from a place, or from the oldest that a board still had by its mark, to
/// where a head says that they end.
fn leads_to(mut place: Place, pieces: &[Evidence], mark: &EvidenceMark, said: Place) -> bool {
    let mut from = 0;
    if mark.first > place.number {
        place = Place {
            number: mark.first,
            chain: Chain(mark.first_chain),
        };
        from = mark.first_seq;
    }
    for piece in pieces.iter().filter(|of| of.seq >= from) {
        place.pass(piece);
    }
    place == said
}
