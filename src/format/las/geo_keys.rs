//! GeoTIFF keys (OGC GeoTIFF 1.1): which system they name, as WKT. A code is looked
//! up in the EPSG data set; what is user-defined is built from its parameters;
//! what they leave open stays open, for a wrong system is worse than none.

use crate::format::crs::{self, epsg, geotiff_method, wkt};

/// Key numbers of the GeoTIFF standard (annex B).
const MODEL: u16 = 1024;
const CITATION: u16 = 1026;
const GEODETIC_CRS: u16 = 2048;
const GEODETIC_CITATION: u16 = 2049;
const ELLIPSOID: u16 = 2056;
const SEMI_MAJOR: u16 = 2057;
const INVERSE_FLATTENING: u16 = 2059;
const PROJECTED_CRS: u16 = 3072;
const PROJECTED_CITATION: u16 = 3073;
const PROJECTION: u16 = 3074;
const METHOD: u16 = 3075;
const LINEAR_UNITS: u16 = 3076;
const LINEAR_UNIT_SIZE: u16 = 3077;

const DOUBLE_PARAMETERS: u16 = 34736;
const ASCII_PARAMETERS: u16 = 34737;
const USER_DEFINED: u16 = 32767;

/// Keys of projection parameters, and what these are called in WKT 1. Of those of
/// one name the first that is there counts.
const PARAMETERS: [(u16, &str); 17] = [
    (3078, "standard_parallel_1"),
    (3079, "standard_parallel_2"),
    (3080, "central_meridian"),
    (3081, "latitude_of_origin"),
    (3082, "false_easting"),
    (3083, "false_northing"),
    (3084, "central_meridian"),
    (3085, "latitude_of_origin"),
    (3086, "false_easting"),
    (3087, "false_northing"),
    (3088, "central_meridian"),
    (3089, "latitude_of_origin"),
    (3090, "false_easting"),
    (3091, "false_northing"),
    (3092, "scale_factor"),
    (3093, "scale_factor"),
    (3094, "azimuth"),
];
const STRAIGHT_POLE: (u16, &str) = (3095, "central_meridian");

/// What a file's keys come to.
#[derive(Debug, PartialEq)]
pub enum Named {
    /// WKT, `EPSG:n` or a name.
    System(String),
    /// Nothing, and why.
    Nothing(String),
}

#[derive(Debug, Default)]
pub struct GeoKeys {
    /// Key and value, of the keys whose value is a short number.
    numbers: Vec<(u16, u16)>,
    doubles: Vec<(u16, f64)>,
    texts: Vec<(u16, String)>,
}

impl GeoKeys {
    pub fn parse(directory: &[u8], doubles: &[u8], ascii: &[u8]) -> GeoKeys {
        let words: Vec<u16> = directory.chunks_exact(2).map(|w| u16::from_le_bytes([w[0], w[1]])).collect();
        let mut keys = GeoKeys::default();
        // The first four words are versions and the count of keys; a count
        // that lies does not matter, since the record's length ends the list.
        let said = words.get(3).copied().unwrap_or(0);
        for entry in words.chunks_exact(4).skip(1).take(usize::from(said)) {
            let [key, location, count, value] = [entry[0], entry[1], entry[2], entry[3]];
            match location {
                0 => keys.numbers.push((key, value)),
                DOUBLE_PARAMETERS => {
                    let double = doubles.as_chunks::<8>().0.get(usize::from(value));
                    let double = double.map(|bytes| f64::from_le_bytes(*bytes)).filter(|d| d.is_finite());
                    keys.doubles.extend(double.map(|double| (key, double)));
                }
                ASCII_PARAMETERS => {
                    let start = usize::from(value).min(ascii.len());
                    let end = (start + usize::from(count)).min(ascii.len());
                    let text = super::text::get(&ascii[start..end]);
                    keys.texts.push((key, text.trim_end_matches('|').trim().to_string()));
                }
                _ => {}
            }
        }
        keys
    }

    fn number(&self, key: u16) -> Option<u16> {
        self.numbers.iter().find(|(k, _)| *k == key).map(|(_, value)| *value)
    }

    fn double(&self, key: u16) -> Option<f64> {
        self.doubles.iter().find(|(k, _)| *k == key).map(|(_, value)| *value)
    }

    /// An EPSG code; 0 means left out and 32767 means user-defined.
    fn code(&self, key: u16) -> Option<u16> {
        self.number(key).filter(|code| (1024..USER_DEFINED).contains(code))
    }

    fn citations(&self) -> impl Iterator<Item = &str> {
        let order = [PROJECTED_CITATION, CITATION, GEODETIC_CITATION];
        order
            .into_iter()
            .flat_map(|key| self.texts.iter().filter(move |(k, _)| *k == key))
            .map(|(_, t)| t.as_str())
    }

    /// The system that they name, without its heights: those have no definitions here.
    pub fn describe(&self) -> Named {
        const PROJECTED_MODEL: u16 = 1;
        if let Some(code) = self.code(PROJECTED_CRS) {
            return Named::System(self.in_its_units(code));
        }
        // ESRI puts WKT into a citation, "ESRI PE String = PROJCS[...".
        if let Some(text) = self.citations().find_map(wkt::within) {
            return Named::System(text.to_string());
        }
        let is_projected = self.number(MODEL) == Some(PROJECTED_MODEL)
            || self.number(PROJECTED_CRS).is_some_and(|code| code != 0)
            || self.number(METHOD).is_some()
            || self.number(PROJECTION).is_some();
        if is_projected {
            // A projection on a known datum is not that datum's degrees.
            return match self.projected() {
                Some(wkt) => Named::System(wkt),
                None => self.cited().unwrap_or_else(|| {
                    Named::Nothing(
                        "its GeoTIFF keys say that its coordinates are projected, but not how; they name no \
                         coordinate reference system"
                            .to_string(),
                    )
                }),
            };
        }
        match self.code(GEODETIC_CRS) {
            Some(code) => {
                Named::System(epsg::wkt(code).map_or_else(|| format!("EPSG:{code}"), str::to_string))
            }
            None => self.cited().unwrap_or_else(|| {
                Named::Nothing("its GeoTIFF keys name no coordinate reference system".to_string())
            }),
        }
    }

    /// The first citation that is more than a word for nothing.
    fn cited(&self) -> Option<Named> {
        let says_nothing = |text: &&str| {
            ["", "unnamed", "unknown", "user-defined", "not specified"]
                .contains(&text.to_ascii_lowercase().as_str())
        };
        self.citations().find(|text| !says_nothing(text)).map(|text| Named::System(text.to_string()))
    }

    /// A code's system; if the file counts in other units than that, as WKT in its
    /// own.
    fn in_its_units(&self, code: u16) -> String {
        let Some(text) = epsg::wkt(code) else { return format!("EPSG:{code}") };
        let unit = self.number(LINEAR_UNITS).and_then(|_| self.linear_unit());
        match unit.and_then(|(name, meters)| crs::in_other_units(text, name, meters)) {
            Some(other) => other,
            None => text.to_string(),
        }
    }

    /// Name and meters of the unit of projected coordinates.
    fn linear_unit(&self) -> Option<(&'static str, f64)> {
        match self.number(LINEAR_UNITS) {
            None | Some(9001) => Some(("metre", 1.0)),
            Some(9002) => Some(("foot", 0.3048)),
            Some(9003) => Some(("US survey foot", 1200.0 / 3937.0)),
            Some(USER_DEFINED) => self.double(LINEAR_UNIT_SIZE).filter(|m| *m > 0.0).map(|m| ("unknown", m)),
            Some(_) => None,
        }
    }

    /// WKT of a user-defined projection.
    fn projected(&self) -> Option<String> {
        let base = self.base()?;
        let (unit, meters) = self.linear_unit()?;
        let name = self.citations().find(|t| !t.is_empty()).unwrap_or("unnamed").replace('"', "");
        let mut parameters: Vec<(&str, f64)> = Vec::new();
        let method = match self.number(PROJECTION) {
            // The zones of UTM, north and south of the equator.
            Some(zone @ (16001..=16060 | 16101..=16160)) => {
                let (zone, south) = (zone % 100, zone > 16100);
                parameters.extend([
                    ("latitude_of_origin", 0.0),
                    ("central_meridian", f64::from(zone) * 6.0 - 183.0),
                    ("scale_factor", 0.9996),
                    ("false_easting", 500_000.0 / meters),
                    ("false_northing", if south { 10_000_000.0 / meters } else { 0.0 }),
                ]);
                "Transverse_Mercator"
            }
            _ => {
                for (key, name) in PARAMETERS.into_iter().chain([STRAIGHT_POLE]) {
                    if let Some(value) = self.double(key)
                        && parameters.iter().all(|(other, _)| *other != name)
                    {
                        parameters.push((name, value));
                    }
                }
                let method = geotiff_method(self.number(METHOD)?)?;
                // Without its meridian nobody knows where it is.
                parameters.iter().find(|(name, _)| *name == "central_meridian")?;
                method
            }
        };
        let parameters: String =
            parameters.iter().map(|(name, value)| format!("PARAMETER[\"{name}\",{value}],")).collect();
        Some(format!(
            "PROJCS[\"{name}\",{base},PROJECTION[\"{method}\"],{parameters}UNIT[\"{unit}\",{meters}]]"
        ))
    }

    /// WKT of the geodetic system below a projection.
    fn base(&self) -> Option<String> {
        if let Some(code) = self.code(GEODETIC_CRS) {
            return epsg::wkt(code).filter(|wkt| wkt.starts_with("GEOGCS")).map(str::to_string);
        }
        let (name, axis, flattening) = match (self.number(ELLIPSOID), self.double(SEMI_MAJOR)) {
            (Some(7019), _) => ("GRS 1980", 6_378_137.0, 298.257_222_101),
            (Some(7030), _) => ("WGS 84", 6_378_137.0, 298.257_223_563),
            (_, Some(axis)) => ("unknown", axis, self.double(INVERSE_FLATTENING)?),
            _ => return None,
        };
        Some(format!(
            "GEOGCS[\"unknown\",DATUM[\"unknown\",SPHEROID[\"{name}\",{axis},{flattening}]],\
             PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]]"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Keys with short values, doubles and texts.
    fn named(numbers: &[(u16, u16)], doubles: &[(u16, f64)], texts: &[(u16, &str)]) -> Named {
        let (mut words, mut double_data, mut ascii) = (Vec::new(), Vec::new(), Vec::new());
        for (key, value) in numbers {
            words.extend([*key, 0, 1, *value]);
        }
        for (key, value) in doubles {
            words.extend([*key, DOUBLE_PARAMETERS, 1, (double_data.len() / 8) as u16]);
            double_data.extend(value.to_le_bytes());
        }
        for (key, text) in texts {
            words.extend([*key, ASCII_PARAMETERS, text.len() as u16 + 1, ascii.len() as u16]);
            ascii.extend(text.bytes().chain([b'|']));
        }
        let front = [1, 1, 0, (words.len() / 4) as u16];
        let directory: Vec<u8> = front.iter().chain(&words).flat_map(|w| w.to_le_bytes()).collect();
        GeoKeys::parse(&directory, &double_data, &ascii).describe()
    }

    fn system(named: Named) -> String {
        match named {
            Named::System(text) => text,
            Named::Nothing(why) => panic!("{why}"),
        }
    }

    fn proj4(named: Named) -> String {
        let text = system(named);
        crs::proj4(&text).unwrap_or(text)
    }

    #[test]
    fn codes_become_wkt_and_unknown_ones_stay() {
        let wkt = system(named(&[(PROJECTED_CRS, 2994)], &[], &[]));
        assert!(wkt.starts_with("PROJCS[\"NAD83(HARN) / Oregon"), "{wkt}");
        assert_eq!(system(named(&[(PROJECTED_CRS, 1100)], &[], &[])), "EPSG:1100");
        assert_eq!(proj4(named(&[(GEODETIC_CRS, 4326)], &[], &[])), "+proj=longlat +datum=WGS84 +no_defs");
    }

    #[test]
    fn a_user_defined_projection_is_built_from_its_keys() {
        let tm = [(3080, 15.0), (3081, 0.0), (3082, 500_000.0), (3083, 0.0), (3092, 0.9996)];
        let numbers =
            [(MODEL, 1), (GEODETIC_CRS, 4258), (PROJECTED_CRS, 32767), (METHOD, 1), (LINEAR_UNITS, 9001)];
        let right = "+proj=tmerc +lon_0=15 +lat_0=0 +x_0=500000 +y_0=0 +k=0.9996 +ellps=GRS80 \
                     +towgs84=0,0,0,0,0,0,0 +units=m +no_defs";
        assert_eq!(proj4(named(&numbers, &tm, &[(CITATION, "unnamed")])), right);
        // In feet, with two parallels, on an ellipsoid of its own, by the keys of
        // the false origin.
        let lcc =
            [(3078, 43.0), (3079, 45.5), (3084, -120.5), (3085, 41.75), (3086, 1_312_335.958), (3087, 0.0)];
        let own = [(MODEL, 1), (PROJECTED_CRS, 32767), (METHOD, 8), (LINEAR_UNITS, 9002), (ELLIPSOID, 7019)];
        let right = "+proj=lcc +lat_1=43 +lat_2=45.5 +lon_0=-120.5 +lat_0=41.75 +x_0=399999.9999984 +y_0=0 \
                     +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 +units=ft +no_defs";
        assert_eq!(proj4(named(&own, &lcc, &[])), right);
        // A zone of UTM by its number alone.
        let zone = [(PROJECTED_CRS, 32767), (PROJECTION, 16119), (GEODETIC_CRS, 4326)];
        let right = "+proj=tmerc +lat_0=0 +lon_0=-69 +k=0.9996 +x_0=500000 +y_0=10000000 +datum=WGS84 +units=m +no_defs";
        assert_eq!(proj4(named(&zone, &[], &[])), right);
    }

    #[test]
    fn a_wrong_system_is_worse_than_none() {
        let is_nothing = |named: Named| matches!(named, Named::Nothing(_));
        // Projected, but all that it says is the datum.
        assert!(is_nothing(named(&[(MODEL, 1), (GEODETIC_CRS, 4326)], &[], &[])));
        assert!(is_nothing(named(
            &[(PROJECTED_CRS, 32767), (GEODETIC_CRS, 4269)],
            &[],
            &[(CITATION, "unnamed")]
        )));
        // Without a meridian; without a datum; by a method that nobody knows.
        assert!(is_nothing(named(&[(GEODETIC_CRS, 4258), (METHOD, 1)], &[(3081, 0.0)], &[])));
        assert!(is_nothing(named(&[(METHOD, 1)], &[(3080, 15.0)], &[])));
        assert!(is_nothing(named(&[(GEODETIC_CRS, 4258), (METHOD, 5)], &[(3080, 15.0)], &[])));
        assert!(is_nothing(named(&[], &[], &[])));
        // Its name is the truth then.
        let cited = named(
            &[(GEODETIC_CRS, 4269), (PROJECTED_CRS, 32767)],
            &[],
            &[(PROJECTED_CITATION, "Oregon North")],
        );
        assert_eq!(system(cited), "Oregon North");
    }

    #[test]
    fn wkt_in_a_citation_is_taken() {
        let esri = "ESRI PE String = PROJCS[\"x\",GEOGCS[\"GCS\",DATUM[\"D_WGS_1984\",SPHEROID[\"WGS_1984\",\
                    6378137.0,298.257223563]],PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",0.0174532925199433]],\
                    PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"Central_Meridian\",-99.0],UNIT[\"Meter\",1.0]]";
        let right = "+proj=tmerc +lon_0=-99 +datum=WGS84 +units=m +no_defs";
        for model in [1, 32767] {
            for key in [CITATION, PROJECTED_CITATION] {
                let keys = [(MODEL, model), (GEODETIC_CRS, 4152)];
                assert_eq!(proj4(named(&keys, &[], &[(key, esri)])), right);
            }
        }
        // Cut before its last bracket, it is none.
        let cut = &esri[..esri.len() - 1];
        assert_ne!(proj4(named(&[(MODEL, 1), (PROJECTED_CRS, 32767)], &[], &[(CITATION, cut)])), right);
    }

    #[test]
    fn feet_are_not_meters() {
        let feet = named(&[(PROJECTED_CRS, 26910), (LINEAR_UNITS, 9003)], &[], &[]);
        let right = "+proj=tmerc +lat_0=0 +lon_0=-123 +k=0.9996 +x_0=500000 +y_0=0 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 +units=us-ft +no_defs";
        assert_eq!(proj4(feet), right);
        let same = named(&[(PROJECTED_CRS, 26910), (LINEAR_UNITS, 9001)], &[], &[]);
        assert_eq!(proj4(same), "+proj=utm +zone=10 +datum=NAD83 +units=m +no_defs");
    }

    #[test]
    fn keys_that_point_outside_their_record_are_harmless() {
        let directory: Vec<u8> =
            [1u16, 1, 0, 2, CITATION, ASCII_PARAMETERS, 60_000, 60_000, 3080, DOUBLE_PARAMETERS, 9, 9]
                .iter()
                .flat_map(|word| word.to_le_bytes())
                .collect();
        assert!(matches!(GeoKeys::parse(&directory, &[1, 2], b"x").describe(), Named::Nothing(_)));
    }
}
