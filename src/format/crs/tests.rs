use super::*;

fn proj4_of(text: &str) -> String {
    proj4(text).unwrap_or_default()
}

/// Systems that real clouds have, from GDAL, PDAL, ESRI, LAStools and TerraSolid; of
/// each the proj4 string that a library of 20 years made of it.
#[test]
fn wkt_of_every_make_becomes_proj4() {
    let geogcs = |datum: &str, ellipsoid: &str, more: &str| {
        format!(
            "GEOGCS[\"x\",DATUM[\"{datum}\",SPHEROID[\"y\",{ellipsoid}]{more}],PRIMEM[\"Greenwich\",0],\
             UNIT[\"degree\",0.0174532925199433]]"
        )
    };
    let nad83 = geogcs("North_American_Datum_1983", "6378137,298.257222101", "");
    let lambert = "PROJECTION[\"Lambert_Conformal_Conic_2SP\"],PARAMETER[\"standard_parallel_1\",43],\
                   PARAMETER[\"standard_parallel_2\",45.5],PARAMETER[\"latitude_of_origin\",41.75],\
                   PARAMETER[\"central_meridian\",-120.5],PARAMETER[\"false_easting\",1312335.958005249]";
    let feet = format!("PROJCS[\"a\",{nad83},{lambert},UNIT[\"foot\",0.3048]]");
    assert_eq!(
        proj4_of(&feet),
        "+proj=lcc +lat_1=43 +lat_2=45.5 +lat_0=41.75 +lon_0=-120.5 +x_0=400000 +datum=NAD83 +units=ft +no_defs"
    );
    // The vertical part of a compound system does not matter.
    let compound = format!("COMPD_CS[\"both\",{feet},VERT_CS[\"v\",VERT_DATUM[\"d\",2005],UNIT[\"m\",1]]]");
    assert_eq!(proj4_of(&compound), proj4_of(&feet));
    // ESRI's one name for both kinds, its datum on a known ellipsoid; units by factor.
    let esri = format!(
        "PROJCS[\"b\",{},PROJECTION[\"Lambert_Conformal_Conic\"],PARAMETER[\"Central_Meridian\",3],\
         PARAMETER[\"Standard_Parallel_1\",46],PARAMETER[\"Latitude_Of_Origin\",46],UNIT[\"Chain\",20.1168]]",
        geogcs("D_Something_New", "6378137.0,298.257222101", "")
    );
    assert_eq!(
        proj4_of(&esri),
        "+proj=lcc +lon_0=3 +lat_1=46 +lat_0=46 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 +to_meter=20.1168 +no_defs"
    );
    // Grads, and a meridian of its own.
    let paris = "GEOGCS[\"NTF (Paris)\",DATUM[\"Nouvelle_Triangulation_Francaise_Paris\",\
                 SPHEROID[\"Clarke 1880 (IGN)\",6378249.2,293.4660212936269],TOWGS84[-168,-60,320,0,0,0,0]],\
                 PRIMEM[\"Paris\",2.33722917],UNIT[\"grad\",0.015707963267949]]";
    let ntf = format!(
        "PROJCS[\"c\",{paris},PROJECTION[\"Lambert_Conformal_Conic_1SP\"],PARAMETER[\"latitude_of_origin\",52],\
         PARAMETER[\"central_meridian\",0],PARAMETER[\"scale_factor\",0.99987742],UNIT[\"metre\",1]]"
    );
    assert_eq!(
        proj4_of(&ntf),
        "+proj=lcc +lat_1=46.8 +lat_0=46.8 +lon_0=0 +k=0.99987742 +a=6378249.2 +rf=293.4660212936269 \
         +towgs84=-168,-60,320,0,0,0,0 +pm=2.33722917 +units=m +no_defs"
    );
    // Writers that give a geographic system meters mean degrees.
    let utm = "PROJCS[\"UTM_10N\",GEOGCS [ \"WGS84\", DATUM [ \"WGS84\", SPHEROID [\"WGS 84\", 6378137.000, \
               298.257223563 ], TOWGS84 [ 0.000, 0.000 , 0,0,0,0,0] ], PRIMEM [ \"Greenwich\", 0.000000 ], \
               UNIT [ \"metres\", 1.00000000] ], PROJECTION[\"Transverse_Mercator\"], \
               PARAMETER[\"Central_Meridian\",-123.0000000000], UNIT [ \"metres\", 1.00000000]]";
    assert_eq!(
        proj4_of(utm),
        "+proj=tmerc +lon_0=-123 +ellps=WGS84 +towgs84=0,0,0,0,0,0,0 +units=m +no_defs"
    );
    // At the pole, by WKT 2.
    let polar = "PROJCRS[\"p\",BASEGEOGCRS[\"WGS 84\",ENSEMBLE[\"World Geodetic System 1984 ensemble\",\
                 MEMBER[\"m\"],ELLIPSOID[\"WGS 84\",6378137,298.257223563,LENGTHUNIT[\"metre\",1]]],\
                 PRIMEM[\"Greenwich\",0,ANGLEUNIT[\"degree\",0.0174532925199433]]],CONVERSION[\"c\",\
                 METHOD[\"Polar Stereographic (variant B)\"],PARAMETER[\"Latitude of standard parallel\",-71,\
                 ANGLEUNIT[\"degree\",0.0174532925199433]],PARAMETER[\"Longitude of origin\",0]],\
                 CS[Cartesian,2],AXIS[\"e\",north,LENGTHUNIT[\"metre\",1]]]";
    assert_eq!(
        proj4_of(polar),
        "+proj=stere +lat_0=-90 +lat_ts=-71 +lon_0=0 +ellps=WGS84 +towgs84=0,0,0,0,0,0,0 +units=m +no_defs"
    );
}

#[test]
fn codes_in_wkt_bring_their_datum_shift() {
    let of = |unit: &str| {
        proj4_of(&format!(
            "PROJCS[\"OSGB\",GEOGCS[\"OSGB 1936\",DATUM[\"OSGB_1936\",SPHEROID[\"Airy 1830\",6377563.396,299.3249646]],\
             PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],PROJECTION[\"Transverse_Mercator\"],\
             PARAMETER[\"latitude_of_origin\",49],PARAMETER[\"central_meridian\",-2],\
             PARAMETER[\"scale_factor\",0.9996012717],PARAMETER[\"false_easting\",400000],\
             PARAMETER[\"false_northing\",-100000],{unit},AUTHORITY[\"EPSG\",\"27700\"]]"
        ))
    };
    let meters = of("UNIT[\"metre\",1]");
    assert_eq!(meters, proj4_of("EPSG:27700"));
    assert!(meters.contains("+towgs84=446.448"), "{meters}");
    // Where it counts otherwise than its code, it is right.
    let feet = of("UNIT[\"foot\",0.3048]");
    assert!(feet.contains("+units=ft") && feet.contains("+x_0=121920 +y_0=-30480"), "{feet}");
    assert!(feet.contains("+towgs84=446.448"), "{feet}");
}

#[test]
fn old_ellipsoids_without_a_shift_are_none() {
    let of = |datum: &str| {
        proj4(&format!(
            "GEOGCS[\"x\",DATUM[\"{datum}\",SPHEROID[\"Bessel\",6377397.155,299.1528128]],PRIMEM[\"Greenwich\",0]]"
        ))
    };
    assert_eq!(of("nobody knows this"), None);
    assert!(of("Deutsches_Hauptdreiecksnetz").is_some_and(|text| text.contains("+towgs84=598.1")));
    assert_eq!(proj4("EPSG:1"), None);
    assert_eq!(proj4("Oregon North"), None);
    assert_eq!(proj4(""), None);
    assert_eq!(proj4("VERT_CS[\"v\",UNIT[\"m\",1]]"), None);
}

/// The viewers' proj4.js has no grids and no units but feet and meters.
#[test]
fn every_code_is_text_that_viewers_read() {
    let mut known = 0;
    for text in (1..=u16::MAX).filter_map(|code| proj4(&format!("EPSG:{code}"))) {
        known += 1;
        for token in text.split_whitespace() {
            let (key, value) = token.split_once('=').unwrap_or((token, ""));
            assert!(token.starts_with('+'), "{text}");
            assert!(key != "+nadgrids" || value == "@null", "{text}");
            assert!(key != "+units" || ["m", "ft", "us-ft"].contains(&value), "{text}");
            assert!(!["+geoidgrids", "+vunits"].contains(&key), "{text}");
        }
    }
    assert!(known > 6000, "{known}");
}

#[test]
fn degrees_are_told_from_meters() {
    let geocentric =
        "GEOCCS[\"x\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],UNIT[\"metre\",1]]";
    for (text, degrees) in [
        ("EPSG:4326", true),
        ("+proj=longlat +datum=WGS84", true),
        ("GEOGCRS[\"x\",DATUM[\"y\",ELLIPSOID[\"z\",6378137,298.257]],CS[ellipsoidal,2]]", true),
        ("COMPD_CS[\"x\",GEOGCS[\"x\"],VERT_CS[\"v\"]]", true),
        ("EPSG:25832", false),
        (geocentric, false),
        ("PROJCS[\"x\",GEOGCS[\"y\"]]", false),
        ("", false),
    ] {
        assert_eq!(is_geographic(text), degrees, "{text}");
    }
    assert_eq!(proj4_of(geocentric), "+proj=geocent +datum=WGS84 +units=m +no_defs");
}

#[test]
fn people_name_systems_by_code_or_wkt() {
    for name in ["EPSG:25832", "epsg: 25832", "25832"] {
        assert!(named(name).is_ok_and(|wkt| wkt.starts_with("PROJCS[\"ETRS89 / UTM zone 32N\"")), "{name}");
    }
    let wkt = named("EPSG:25832").unwrap_or_default();
    assert_eq!(named(&wkt), Ok(wkt));
    assert!(named("EPSG:1").is_err_and(|why| why.contains("EPSG:1 ")));
    assert!(named("utm 32").is_err_and(|why| why.contains("utm 32")));
    assert!(named("PROJCS[\"cut").is_err());
}

#[test]
fn hostile_wkt_is_no_wkt() {
    for text in
        ["A[".repeat(100_000), "PROJCS[".to_string(), "PROJCS[\"".to_string(), "PROJCS[1e999]".to_string()]
    {
        assert_eq!(wkt::parse(&text), None);
        assert_eq!(proj4(&text), None);
    }
    assert_eq!(wkt::within(&format!("x = {}", "PROJCS[".repeat(1000))), None);
    assert_eq!(wkt::within("é PROJCS[\"ü\"] é"), Some("PROJCS[\"ü\"]"));
}
