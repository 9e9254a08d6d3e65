//! Which of a file's records says where on Earth the coordinates are: WKT, or
//! GeoTIFF keys (LAS 1.4 R15, section 2.6). Files have both, stale or empty ones
//! too, and records of libLAS from before the standard had any for WKT.

use super::geo_keys::{GeoKeys, Named};
use super::vlr::{self, Vlr};

const PROJECTION: &str = "LASF_Projection";

/// A coordinate reference system in words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Crs {
    /// WKT wherever there is one; otherwise `EPSG:n`, or as much as the file says.
    pub text: String,
    pub source: CrsSource,
}

/// Which of the places that a file has for it the CRS was found in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CrsSource {
    Wkt,
    GeoKeys,
}

impl CrsSource {
    pub fn name(self) -> &'static str {
        match self {
            CrsSource::Wkt => "WKT",
            CrsSource::GeoKeys => "GeoTIFF keys",
        }
    }
}

/// Finds the CRS in a file's records. Of WKT and GeoTIFF keys the one that the
/// header says holds; the other only where that says nothing. WKT of libLAS comes
/// last: it is from before LAS 1.4, and programs that change the keys leave it as
/// it was.
pub fn find(records: &[Vlr], is_wkt: bool, notes: &mut Vec<String>) -> Option<Crs> {
    let of_user = |user: &str| {
        let wkt = records.iter().filter(|r| r.is(user, vlr::WKT)).find_map(|r| wkt(&r.data));
        wkt.map(|text| Crs { text, source: CrsSource::Wkt })
    };
    let (standard, old) = (of_user(PROJECTION), of_user("liblas"));
    if standard.is_none() && old.is_none() && records.iter().any(|r| r.id == vlr::WKT) {
        notes.push("its WKT record is empty".to_string());
    }
    if is_wkt && standard.is_some() {
        return standard;
    }
    let find = |id| records.iter().find(|r| r.is(PROJECTION, id)).map(|r| r.data.as_slice());
    let keys = find(34735).map(|directory| {
        let [doubles, ascii] = [34736, 34737].map(|id| find(id).unwrap_or_default());
        GeoKeys::parse(directory, doubles, ascii).describe()
    });
    let of_keys = |text: String| Crs { text, source: CrsSource::GeoKeys };
    let has_wkt = standard.is_some() || old.is_some();
    match keys {
        // A name alone is less than WKT from wherever.
        Some(Named::System(text)) if !has_wkt || text.contains('[') => Some(of_keys(text)),
        None | Some(Named::System(_)) => standard.or(old),
        Some(Named::Nothing(why)) if !has_wkt => {
            notes.push(why);
            None
        }
        Some(Named::Nothing(_)) => standard.or(old),
    }
}

/// The records that a CRS is found in, to be written as they are: the first of
/// each kind, the standard's before those of libLAS.
pub fn records(records: Vec<Vlr>) -> Vec<Vlr> {
    let (standard, old): (Vec<Vlr>, Vec<Vlr>) =
        records.into_iter().filter(Vlr::is_of_crs).partition(|record| record.is(PROJECTION, record.id));
    let mut found: Vec<Vlr> = Vec::new();
    for record in standard.into_iter().chain(old) {
        if found.iter().all(|other| other.id != record.id) {
            found.push(record);
        }
    }
    found
}

/// The text of a WKT record, unless it is empty or no WKT at all.
fn wkt(data: &[u8]) -> Option<String> {
    let text = super::text::get(data);
    (text.starts_with(|c: char| c.is_ascii_alphabetic()) && text.contains('[')).then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(id: u16, data: Vec<u8>) -> Vlr {
        Vlr { user: PROJECTION.to_string(), id, data }
    }

    fn keys(entries: &[[u16; 4]]) -> Vec<u8> {
        let mut words = vec![1, 1, 0, entries.len() as u16];
        words.extend(entries.iter().flatten());
        words.iter().flat_map(|w| w.to_le_bytes()).collect()
    }

    fn found(records: &[Vlr]) -> Option<Crs> {
        find(records, true, &mut Vec::new())
    }

    fn wkt_of(user: &str, name: &str) -> Vlr {
        let data = format!("PROJCS[\"{name}\"]\0\0").into_bytes();
        Vlr { user: user.to_string(), id: vlr::WKT, data }
    }

    fn utm_33() -> Vlr {
        record(34735, keys(&[[3072, 0, 1, 32633]]))
    }

    /// Where it was found, and what viewers make of it.
    fn shown(crs: Option<Crs>) -> (&'static str, String) {
        let crs = crs.expect("a system");
        (crs.source.name(), crate::format::crs::proj4(&crs.text).unwrap_or(crs.text))
    }

    const UTM_33: &str = "+proj=utm +zone=33 +datum=WGS84 +units=m +no_defs";

    #[test]
    fn the_header_says_whether_wkt_or_keys_hold() {
        let records = [utm_33(), wkt_of(PROJECTION, "x")];
        let find = |is_wkt| find(&records, is_wkt, &mut Vec::new());
        assert_eq!(shown(find(true)), ("WKT", "PROJCS[\"x\"]".to_string()));
        assert_eq!(shown(find(false)), ("GeoTIFF keys", UTM_33.to_string()));
        // What is alone holds, whatever the header says.
        assert_eq!(shown(super::find(&records[1..], false, &mut Vec::new())).0, "WKT");
        assert_eq!(shown(super::find(&records[..1], true, &mut Vec::new())).0, "GeoTIFF keys");
    }

    #[test]
    fn wkt_of_liblas_is_asked_last() {
        let old = wkt_of("liblas", "old one");
        for is_wkt in [false, true] {
            let find = |records: &[Vlr]| shown(find(records, is_wkt, &mut Vec::new()));
            assert_eq!(find(&[old.clone(), utm_33()]), ("GeoTIFF keys", UTM_33.to_string()));
            assert_eq!(find(&[old.clone(), wkt_of(PROJECTION, "x")]).1, "PROJCS[\"x\"]");
            assert_eq!(find(std::slice::from_ref(&old)).1, "PROJCS[\"old one\"]");
            // Keys that only have a code nobody knows are no system.
            let unknown = record(34735, keys(&[[3072, 0, 1, 1100]]));
            assert_eq!(find(&[old.clone(), unknown]).1, "PROJCS[\"old one\"]");
        }
        let kept = super::records(vec![old, wkt_of(PROJECTION, "x")]);
        assert_eq!(kept, [wkt_of(PROJECTION, "x")]);
    }

    #[test]
    fn empty_wkt_gives_way_to_keys_and_empty_keys_to_wkt_or_nothing() {
        let mut notes = Vec::new();
        let records = [record(2112, vec![0; 4]), utm_33()];
        let crs = find(&records, true, &mut notes);
        assert_eq!(shown(crs), ("GeoTIFF keys", UTM_33.to_string()));
        assert_eq!(notes.len(), 1);
        for empty in [keys(&[]), Vec::new(), vec![0; 8]] {
            let (wkt, mut notes) = (wkt_of(PROJECTION, "x"), Vec::new());
            for records in [[record(34735, empty.clone()), wkt.clone()], [wkt, record(34735, empty)]] {
                for is_wkt in [false, true] {
                    assert_eq!(shown(find(&records, is_wkt, &mut notes)).1, "PROJCS[\"x\"]");
                }
            }
            assert_eq!(notes, [""; 0]);
        }
        assert_eq!(found(&[record(34735, keys(&[]))]), None);
        assert_eq!(found(&[record(34735, vec![1, 0, 1])]), None);
        assert_eq!(found(&[]), None);
    }
}
