//! Spectra in the layouts of instruments and programs, written for these tests: each with its values by hand.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "these are tests")]

use std::fs;

use fluorspar_format::{
    MeasuredSpectra, SpectrumColumns, SpectrumOptions, SpectrumQuantity, ValueUnit, read_spectra,
};

fn read_bytes(name: &str, content: &[u8], options: &SpectrumOptions) -> Result<MeasuredSpectra, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, content).unwrap();
    let without_folder = |error: fluorspar_format::FormatError| {
        error.to_string().replace(&format!("{}/", folder.path().display()), "")
    };
    read_spectra(&path, options).map_err(without_folder)
}

fn as_quantity(quantity: SpectrumQuantity) -> SpectrumOptions {
    SpectrumOptions { columns: SpectrumColumns::One, quantity, ..SpectrumOptions::default() }
}

/// The one spectrum of a file: wavelengths, nm, and values.
fn one(name: &str, content: impl AsRef<[u8]>, quantity: SpectrumQuantity) -> (Vec<f64>, Vec<f64>, String) {
    let read =
        read_bytes(name, content.as_ref(), &as_quantity(quantity)).unwrap_or_else(|error| panic!("{error}"));
    let curve = &read.curves[0].curve;
    (curve.wavelengths_nm().to_vec(), curve.values().to_vec(), read.read_as.join("; "))
}

fn assert_near(found: &[f64], wanted: &[f64], name: &str) {
    assert_eq!(found.len(), wanted.len(), "{name}: {found:?}");
    for (found, wanted) in found.iter().zip(wanted) {
        assert!((found - wanted).abs() <= 1e-9 * wanted.abs().max(1.0), "{name}: {found} for {wanted}");
    }
}

/// A file of a spectrometer: its name, text, and what it is read for; then wavelengths and values.
type Layout<'a> = (&'a str, &'a str, SpectrumQuantity, &'a [f64], &'a [f64]);

const LAYOUTS: &[Layout] = &[
    (
        "SpectraSuite and OceanView: no header, decimal commas",
        "SpectraSuite Data File\n+++++++++++++++\nDate: Mon Jan 14 17:36:35 GMT 2008\nIntegration Time (usec): 100000\n\
             Number of Pixels in File: 3\n>>>>>Begin Processed Spectral Data<<<<<\n400,10\t0,5\n400,35\t0,25\n400,6\t0,125\n\
             >>>>>End Processed Spectral Data<<<<<\n",
        SpectrumQuantity::Stored,
        &[400.1, 400.35, 400.6],
        &[0.5, 0.25, 0.125],
    ),
    (
        "Jaz: dark, reference, sample and what was computed, none at the end",
        "Jaz Data File\n+++++++\nDate: Mon Aug 29 16:23:13 2011\nUser: jaz\nSpectrometer: JAZ\nBoxcar: 2\nW\tD\tR\tS\tP\n\
             >>>>>Begin Spectral Data<<<<<\n410.5\t3.0\t103.0\t53.0\t50.0\n411.0\t2.0\t202.0\t42.0\t20.0\n411.5\t1.0\t1.0\t1.0\tnan\n\
             >>>>>End Spectral Data<<<<<\n",
        SpectrumQuantity::SpectralPower,
        &[410.5, 411.0],
        &[50.0, 20.0],
    ),
    (
        "AvaSoft: names above units, semicolons, a space before numbers",
        "0804016U1-\nIntegration time: 100.00 ms\nAverage: 20 scans\n\nWave   ;Sample   ;Dark     ;Reference;Transmittance\n\
             [nm]   ;[counts] ;[counts] ;[counts]\n\n 300.00;   530.0;    30.0;  1030.0; 50.000\n 300.60;   230.0;    30.0;  1030.0; 20.000\n\
             ",
        SpectrumQuantity::Fraction,
        &[300.0, 300.6],
        &[0.5, 0.2],
    ),
    (
        "CRAIC: descending, CR LF",
        "a feather\r\nReflectance\r\nIT1=448.99ms:Obj=15X\r\n600.0\t0.75\r\n599.5\t0.5\r\n599.0\t0.25\r\n",
        SpectrumQuantity::Fraction,
        &[599.0, 599.5, 600.0],
        &[0.25, 0.5, 0.75],
    ),
    (
        "Agilent: percent and standard deviation, all below 1",
        "Wavelength (nm);Transmittance(%);Std.Dev.\n400;0.012;0.007\n401;0.011;0.005\n402;0.030;0.008\n",
        SpectrumQuantity::Fraction,
        &[400.0, 401.0, 402.0],
        &[1.2e-4, 1.1e-4, 3e-4],
    ),
    (
        "LI-COR 1800: quoted lines, blanks, photons",
        "\"FILE:FL2\"\n\"REM: TLD 36W/865       (QNTM)\"\n\"LIMS: 300- 900NM\"\n\"INT:  1NM\"\n 300  3.000E+00\n 400  4.000E+00\n",
        SpectrumQuantity::SpectralPower,
        &[300.0, 400.0],
        &[0.01, 0.01],
    ),
    (
        "LI-180 and others: a wavelength with its unit in each line",
        "Model Name\tLI-180\nTime\t2021/03/02\nPPFD\t129.8\n380nm\t0.25\n381nm\t0.5\n382nm\t0.75\n",
        SpectrumQuantity::Stored,
        &[380.0, 381.0, 382.0],
        &[0.25, 0.5, 0.75],
    ),
    (
        "ENLIGHTEN: pixels and wavenumbers beside the wavelength",
        "ENLIGHTEN Version,2.1.14\nSerial Number,WP-00413\n\nPixel,Wavelength,Wavenumber,Processed\n0,792.33,90.5,1196.0\n1,792.61,95.0,1198.0\n",
        SpectrumQuantity::Stored,
        &[792.33, 792.61],
        &[1196.0, 1198.0],
    ),
    (
        "Spectral libraries: units above, micrometers, percent",
        "Name: Grass\nX Units:  Wavelength (micrometers)\nY Units:  Reflectance (percent)\nFirst X Value: 0.40\n\n\
             0.40\t4.0\n0.41\t5.0\n0.42\t6.0\n",
        SpectrumQuantity::Fraction,
        &[400.0, 410.0, 420.0],
        &[0.04, 0.05, 0.06],
    ),
    (
        "np.savetxt: a header behind #",
        "# wavelength [nm], transmissivity\n400,0.01\n450,0.02\n500,0.45\n",
        SpectrumQuantity::Fraction,
        &[400.0, 450.0, 500.0],
        &[0.01, 0.02, 0.45],
    ),
    (
        "curves read off a figure: no word for a wavelength, out of order, decimal commas",
        "Line 2 x;Line 2 y\n8,5E2;9,3E-1\n8,4E2;9,2E-1\n8,3E2;9,1E-1\n8,2E2;9,0E-1\n8,25E2;9,05E-1\n8,1E2;8E-1\n8E2;7E-1\n7,9E2;6E-1\n",
        SpectrumQuantity::Fraction,
        &[790.0, 800.0, 810.0, 820.0, 825.0, 830.0, 840.0, 850.0],
        &[0.6, 0.7, 0.8, 0.9, 0.905, 0.91, 0.92, 0.93],
    ),
    (
        "two numbers a line and nothing else",
        "402.2,0.26\n402.8,0.27\n403.4,0.28\n",
        SpectrumQuantity::Fraction,
        &[402.2, 402.8, 403.4],
        &[0.26, 0.27, 0.28],
    ),
    (
        "blanks and tabs mixed",
        "# a film, new\nw.length transmittance\n190 1\n191 2\n192\t90\n",
        SpectrumQuantity::Fraction,
        &[190.0, 191.0, 192.0],
        &[0.01, 0.02, 0.9],
    ),
    (
        "Shimadzu: quoted cells, optical density",
        "\"Sample 1 - RawData\"\n\"Wavelength nm.\",\"Abs.\"\n500.00,2.0\n501.00,1.0\n502.00,0.0\n",
        SpectrumQuantity::Fraction,
        &[500.0, 501.0, 502.0],
        &[0.01, 0.1, 1.0],
    ),
    (
        "three readings at one wavelength, and a line that stands in twice",
        "nm,R\n550,0.3\n550,0.3\n550,0.9\n560,0.4\n570,0.5\n580,0.5\n590,0.5\n600,0.5\n610,0.5\n620,0.5\n620,0.5\n630,0.5\n640,0.5\n650,0.5\n660,0.5\n670,0.5\n680,0.5\n690,0.5\n700,0.5\n710,0.5\n720,0.5\n730,0.5\n740,0.5\n750,0.5\n",
        SpectrumQuantity::Fraction,
        &[
            550.0, 560.0, 570.0, 580.0, 590.0, 600.0, 610.0, 620.0, 630.0, 640.0, 650.0, 660.0, 670.0, 680.0,
            690.0, 700.0, 710.0, 720.0, 730.0, 740.0, 750.0,
        ],
        &[
            0.5, 0.4, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5,
            0.5, 0.5,
        ],
    ),
    (
        "the concentration in the name of a sample",
        "wavelength_nm,Intralipid 1%\n400,0.2\n500,0.35\n600,0.5\n",
        SpectrumQuantity::Fraction,
        &[400.0, 500.0, 600.0],
        &[0.2, 0.35, 0.5],
    ),
    (
        "absolute irradiance in another unit",
        "nm,irradiance (\u{b5}W/cm\u{b2}/nm)\n400,100\n500,50\n600,0\n",
        SpectrumQuantity::AbsolutePower,
        &[400.0, 500.0, 600.0],
        &[1.0, 0.5, 0.0],
    ),
    ("old line ends", "nm,T\r400,0.5\r410,0.25\r", SpectrumQuantity::Fraction, &[400.0, 410.0], &[0.5, 0.25]),
    (
        "wavenumbers",
        "Wavenumber (cm-1),Transmittance\n25000,0.5\n20000,0.25\n",
        SpectrumQuantity::Fraction,
        &[400.0, 500.0],
        &[0.5, 0.25],
    ),
    (
        "a background before the light, names and dates before the wavelength",
        "sample,date,Wavelength (nm),Background,Irradiance\nA 1,2024-01-31,400,9,0.5\nA 1,2024-01-31,410,9,0.25\n",
        SpectrumQuantity::SpectralPower,
        &[400.0, 410.0],
        &[0.5, 0.25],
    ),
    (
        "values in W/nm that might be wavelengths",
        "Wavelength (nm),Spectral power (W/nm)\n400,500\n410,250\n",
        SpectrumQuantity::SpectralPower,
        &[400.0, 410.0],
        &[500.0, 250.0],
    ),
    (
        "edges of bands",
        "wavelength start,wavelength end,irradiance\n400,410,0.5\n410,420,0.25\n",
        SpectrumQuantity::SpectralPower,
        &[405.0, 415.0],
        &[0.5, 0.25],
    ),
    (
        "a remark about a standard is no unit",
        "# Reflectance standard: Spectralon (99 %)\n# Absorber: OD 3 glass\n# Unit 3, relative uncertainty 2 %\n\
         wavelength_nm,reflectance\n400,0.1\n450,0.5\n500,0.9\n",
        SpectrumQuantity::Fraction,
        &[400.0, 450.0, 500.0],
        &[0.1, 0.5, 0.9],
    ),
    (
        "edges of bands below names of two words",
        " SPECTRAL IRRADIANCE (W m-2 nm-1):\n\n LOWER WVL  UPPER WVL  DIRECT     DIFFUSE DOWN\n 400.0 410.0 0.5 1.0\n \
         410.0 420.0 0.25 1.0\n 420.0 430.0 0.25 1.0\n 430.0 440.0 0.25 1.0\n 440.0 450.0 0.25 1.0\n 450.0 460.0 0.25 1.0\n \
         460.0 470.0 0.25 1.0\n 470.0 480.0 0.25 1.0\n",
        SpectrumQuantity::SpectralPower,
        &[405.0, 415.0, 425.0, 435.0, 445.0, 455.0, 465.0, 475.0],
        &[0.5, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25],
    ),
    (
        "edges beside the middles of bands",
        "center wavelength,lower,upper,T\n405,400,410,0.5\n415,410,420,0.5\n425,420,430,0.5\n435,430,440,0.25\n",
        SpectrumQuantity::Fraction,
        &[405.0, 415.0, 425.0, 435.0],
        &[0.5, 0.5, 0.5, 0.25],
    ),
    (
        "edges in micrometers",
        "Wavelength min (um),Wavelength max (um),R\n0.4,0.41,0.5\n0.41,0.42,0.25\n",
        SpectrumQuantity::Fraction,
        &[405.0, 415.0],
        &[0.5, 0.25],
    ),
    (
        "the unit above: percent of an axis",
        "Sample: a\nY axis: %T\n400\t0.5\n410\t0.25\n",
        SpectrumQuantity::Fraction,
        &[400.0, 410.0],
        &[0.005, 0.0025],
    ),
    (
        "the unit above: thousandths of a density",
        "Sample: a\nY Units: mOD\n400\t2000\n410\t1000\n",
        SpectrumQuantity::Fraction,
        &[400.0, 410.0],
        &[0.01, 0.1],
    ),
    (
        "a running number before, a width behind the wavelength",
        "No.,Wavelength (nm),Bandwidth (nm),T\n200,400,5,0.5\n201,410,5,0.25\n",
        SpectrumQuantity::Fraction,
        &[400.0, 410.0],
        &[0.5, 0.25],
    ),
    (
        "axes of a fluorometer by name above the numbers",
        "sample1\nType,Emission Scan\nExcitation Wavelength,385.00\nLabels,\nXAxis,Wavelength(nm)\nYAxis,Counts,\n\n\
             400,200,\n500,150,\n600,300,\n",
        SpectrumQuantity::SpectralPower,
        &[400.0, 500.0, 600.0],
        &[0.5, 0.3, 0.5],
    ),
    (
        "the axis of wavelengths named last",
        "Type,Emission Scan\nYAxis,Counts,\nXAxis,Wavelength(nm)\n400,200,\n500,150,\n600,300,\n",
        SpectrumQuantity::SpectralPower,
        &[400.0, 500.0, 600.0],
        &[0.5, 0.3, 0.5],
    ),
    (
        "a title as wide as its table, and a first column without anything",
        "FEL0450 Data,,,\n,Wavelength (nm),Transmission (%),Optical Density\n,400,1,2\n,450,50,0.3\n,500,90,.05\n",
        SpectrumQuantity::Fraction,
        &[400.0, 450.0, 500.0],
        &[0.01, 0.5, 0.9],
    ),
    (
        "words beside the first rows",
        "Data,,Wavelength (nm),T (%)\nProduct,,400,1\nA filter,,450,50\n,,500,90\n,,550,90\n",
        SpectrumQuantity::Fraction,
        &[400.0, 450.0, 500.0, 550.0],
        &[0.01, 0.5, 0.9, 0.9],
    ),
    (
        "percent of a sample called A",
        "A,,B,\nWavelength (nm),%T,Wavelength (nm),%T\n400,50,400,1\n410,25,410,2\n",
        SpectrumQuantity::Transmittance,
        &[400.0, 410.0],
        &[0.5, 0.25],
    ),
    (
        "percent of A beside B",
        "nm,A (%),B (%)\n400,50,1\n410,25,2\n",
        SpectrumQuantity::Fraction,
        &[400.0, 410.0],
        &[0.5, 0.25],
    ),
    (
        "decibels of an attenuation",
        "nm,Attenuation (dB)\n400,20\n410,10\n",
        SpectrumQuantity::Fraction,
        &[400.0, 410.0],
        &[0.01, 0.1],
    ),
    (
        "a density with its unit",
        "nm,Density (OD)\n400,2\n410,1\n",
        SpectrumQuantity::Fraction,
        &[400.0, 410.0],
        &[0.01, 0.1],
    ),
    (
        "decibels of a transmission",
        "Wavelength (nm),T (dB)\n400,-20\n500,-10\n600,0\n",
        SpectrumQuantity::Fraction,
        &[400.0, 500.0, 600.0],
        &[0.01, 0.1, 1.0],
    ),
];

#[test]
fn layouts_of_instruments_are_read() {
    for (name, text, quantity, nm, values) in LAYOUTS {
        let (found_nm, found, _) = one("t.txt", text, *quantity);
        assert_near(&found_nm, nm, name);
        assert_near(&found, values, name);
    }
}

#[test]
fn encodings_are_read() {
    let text = "Wellenlänge (nm);Transmission\n400;0,5\n410;0,25\n";
    let utf16: Vec<u8> =
        [0xFF, 0xFE].into_iter().chain(text.encode_utf16().flat_map(u16::to_le_bytes)).collect();
    let latin: Vec<u8> = text.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
    for bytes in [text.as_bytes().to_vec(), utf16, latin] {
        let (nm, values, read_as) = one("t.csv", bytes, SpectrumQuantity::Fraction);
        assert_eq!((nm, values), (vec![400.0, 410.0], vec![0.5, 0.25]));
        assert_eq!(read_as, "decimal commas");
    }
}

#[test]
fn jcamp_and_tm_27_are_read() {
    let pairs = "##TITLE= a\n##XUNITS= NANOMETERS\n##YUNITS= TRANSMITTANCE\n##XFACTOR= 1.0\n##YFACTOR= 0.5\n##XYPOINTS= (XY..XY)\n\
                 400.0, 1.0\n410.0, 0.5\n##END=\n";
    assert_eq!(one("t.jdx", pairs, SpectrumQuantity::Fraction).1, [0.5, 0.25]);
    let in_a_line = pairs.replace("400.0, 1.0\n410.0, 0.5", "400,1.0 410,0.5");
    assert_eq!(one("t.jdx", in_a_line, SpectrumQuantity::Fraction).1, [0.5, 0.25]);
    let even = "##TITLE= a\n##XUNITS= MICROMETERS\n##YUNITS= REFLECTANCE\n##FIRSTX= 0.4\n##LASTX= 0.43\n##NPOINTS= 4\n\
                ##XFACTOR= 1\n##YFACTOR= 1\n##XYDATA= (X++(Y..Y))\n0.4 0.1 0.2\n0.42 0.3 0.4\n##END=\n";
    let (nm, values, _) = one("t.dx", even, SpectrumQuantity::Fraction);
    assert_near(&nm, &[400.0, 410.0, 420.0, 430.0], "even");
    assert_near(&values, &[0.1, 0.2, 0.3, 0.4], "even");
    let xml = "<?xml version=\"1.0\"?>\n<IESTM2714 xmlns=\"iestm2714\" version=\"1.0\"><SpectralDistribution>\
               <SpectralQuantity>irradiance</SpectralQuantity><SpectralData wavelength=\"400\">0.25</SpectralData>\
               <SpectralData wavelength=\"500\">0.5</SpectralData></SpectralDistribution></IESTM2714>\n";
    assert_eq!(one("t.spdx", xml, SpectrumQuantity::SpectralPower).1, [0.25, 0.5]);
}

#[test]
fn spectra_of_cgats_are_columns() {
    let text = "CTI3   \n\nORIGINATOR \"a\"\nNUMBER_OF_FIELDS 4\nBEGIN_DATA_FORMAT\nSAMPLE_ID SAMPLE_NAME SPEC_400 SPEC_410\nEND_DATA_FORMAT\n\n\
                NUMBER_OF_SETS 2\nBEGIN_DATA\n1 \"light blue\" 50.0\n25.0\n2 red 1.0 2.5\nEND_DATA\n";
    let options =
        SpectrumOptions { columns: SpectrumColumns::All, ..as_quantity(SpectrumQuantity::Fraction) };
    let read = read_bytes("t.ti3", text.as_bytes(), &options).unwrap();
    let found: Vec<_> = read.curves.iter().map(|of| (of.name.as_str(), of.curve.values().to_vec())).collect();
    assert_eq!(found, [("light blue (%)", vec![0.5, 0.25]), ("red (%)", vec![0.01, 0.025])]);
    assert_eq!(read.curves[0].curve.wavelengths_nm(), [400.0, 410.0]);
    let short = text.replace("25.0\n", "");
    let error = read_bytes("t.ti3", short.as_bytes(), &options).unwrap_err();
    assert!(error.contains("t.ti3:11: this sample has 7 cells but the format has 4 fields"), "{error}");
    let colors = text.replace("SPEC_400 SPEC_410", "LAB_L LAB_A");
    let error = read_bytes("t.ti3", colors.as_bytes(), &options).unwrap_err();
    assert!(error.contains("this CGATS file holds no spectra"), "{error}");
    let sekonic = "Date Saved,2020/01/31\nTitle,a\nSpectral Data 380[nm],0.5\nSpectral Data 381[nm],0.25\n";
    let error = read_bytes("t.csv", sekonic.as_bytes(), &options).unwrap_err();
    assert!(error.contains("this is a file of a Sekonic spectrometer"), "{error}");
}

#[test]
fn units_of_headers_become_the_quantity() {
    // 0.27 A/W at 610 nm are 0.27 · 1239.84 / 610 electrons a photon
    let (_, qe, read_as) =
        one("t.csv", "wavelength_nm,R (A/W)\n600,0.3\n610,0.27\n", SpectrumQuantity::QuantumEfficiency);
    assert!((qe[1] - 0.548_78).abs() < 1e-5, "{qe:?}");
    assert_eq!(read_as, "amperes per watt");
    let (_, qe, read_as) =
        one("t.csv", "nm,S (mA/W)\n600,300\n610,270\n", SpectrumQuantity::QuantumEfficiency);
    assert!(
        (qe[1] - 0.548_78).abs() < 1e-5 && read_as == "values times 0.001; amperes per watt",
        "{read_as}"
    );
    // Bands of several widths may hold power or power per nm: what was taken is told
    let bands = b"start_nm,end_nm,irradiance\n400,410,2\n410,430,4\n430,440,2\n";
    let (_, power, read_as) = one("bands.csv", bands, SpectrumQuantity::SpectralPower);
    assert!(power == [2.0, 4.0, 2.0] && read_as.contains("values per nm of the band"), "{read_as}");
    // Photons at 400 nm have 1.5 times the energy of those at 600 nm
    let (_, power, _) =
        one("t.csv", "nm,photon flux (umol m-2 s-1 nm-1)\n400,1\n600,1\n", SpectrumQuantity::SpectralPower);
    assert!((power[0] / power[1] - 1.5).abs() < 1e-12);
    // What the caller says wins
    let options =
        SpectrumOptions { unit: Some(ValueUnit::Percent), ..as_quantity(SpectrumQuantity::Fraction) };
    let read = read_bytes("t.csv", b"nm,T\n400,0.5\n410,0.25\n", &options).unwrap();
    assert_eq!(read.curves[0].curve.values(), [0.005, 0.0025]);
    // A column by its name without the unit, and its standard error
    let options = SpectrumOptions {
        columns: SpectrumColumns::Named(vec!["T".into()]),
        quantity: SpectrumQuantity::Fraction,
        ..SpectrumOptions::default()
    };
    let read = read_bytes("t.csv", b"nm,other,T (%),Std.Dev.\n400,9,50,2\n410,9,25,1\n", &options).unwrap();
    assert_eq!(read.curves[0].curve.values(), [0.5, 0.25]);
    assert_eq!(read.curves[0].standard_error.as_ref().unwrap().values(), [0.02, 0.01]);
}

#[test]
fn values_that_can_not_be_the_quantity_are_refused_with_their_cure() {
    let cases = [
        (
            "nm,R\n400,45\n410,54\n",
            SpectrumQuantity::QuantumEfficiency,
            "t.csv:2: column \"R\" holds 45, more electrons than a photon frees. Give the file as { csv = \"t.csv\", unit = \"percent\" }",
        ),
        (
            "nm,x\n400,450\n410,54\n",
            SpectrumQuantity::Fraction,
            "t.csv:2: column \"x\" holds 450, more than 1. Choose a column that holds a transmittance or reflectance",
        ),
        (
            "nm,T\n400,0.5\n410,60\n420,0.5\n430,0.25\n",
            SpectrumQuantity::Fraction,
            "t.csv:3: column \"T\" holds 60, more than 1. Correct this value, or remove the line",
        ),
        (
            "nm,OD\n400,5\n410,0\n420,1\n",
            SpectrumQuantity::Fraction,
            "t.csv:3: column \"OD\" holds an optical density of 0 at 410 nm beside 5 at 400 nm. Write",
        ),
        (
            "nm,S (A/W)\n400,45\n410,95\n420,95\n",
            SpectrumQuantity::QuantumEfficiency,
            "in unit \"a_per_w\". Choose a column that holds a quantum efficiency",
        ),
        (
            "nm,Power (dBm)\n400,-45\n410,-54\n",
            SpectrumQuantity::SpectralPower,
            "column \"Power (dBm)\" is in \"dbm\", which isn't known here. Export it in %, OD",
        ),
        (
            "nm,T [perc]\n400,0.5\n410,0.5\n",
            SpectrumQuantity::Fraction,
            "column \"T [perc]\" is in \"perc\", which isn't known here. Export it in %, OD",
        ),
        (
            "nm,T (%)\n400,45\n410,154\n",
            SpectrumQuantity::Fraction,
            "column \"T (%)\" holds 154, more than 1 in unit \"percent\". Choose a column",
        ),
        (
            "wavelength,x\n2900,45\n7990,154\n",
            SpectrumQuantity::Stored,
            "the wavelengths run from 2900 to 7990 without a unit. Write the unit into the header",
        ),
        (
            "<html><body><pre>\n400 0.5\n410 0.25\n</pre></body></html>\n",
            SpectrumQuantity::Fraction,
            "this is an HTML page, not a table. Copy its table",
        ),
        (
            "nm,flux [erg]\n400,45\n410,54\n",
            SpectrumQuantity::SpectralPower,
            "column \"flux [erg]\" is in \"erg\", which isn't known here.",
        ),
        (
            "nm,OD\n400,1\n410,2\n",
            SpectrumQuantity::SpectralPower,
            "column \"OD\": its values are optical density, not the spectrum of a light.",
        ),
        (
            "nm,T\n400,0.5\n410,-0.25\n420,0.5\n",
            SpectrumQuantity::Fraction,
            "column \"T\" holds -0.25, below zero.",
        ),
        (
            "nm,(1.e. Reflectance (%)\n400,4\n410,3\n",
            SpectrumQuantity::Transmittance,
            "is of what comes back, not of what passes. Export the transmittance; of a mirror, name the column: { csv = \"t.csv\"",
        ),
        (
            "nm,R (%)\n400,4\n410,3\n",
            SpectrumQuantity::Transmittance,
            "column \"R (%)\" is of what comes back",
        ),
        (
            "# Y units: Reflectance (%)\nnm,x\n400,4\n410,3\n",
            SpectrumQuantity::Transmittance,
            "column \"x\" is of what",
        ),
    ];
    for (text, quantity, said) in cases {
        let error = read_bytes("t.csv", text.as_bytes(), &as_quantity(quantity)).unwrap_err();
        assert!(error.contains(said), "{error}");
    }
    // A mirror that is named as such, T of what reflects little, the red one of three filters
    for (text, column) in [
        ("nm,R (%)\n400,50\n410,25\n", SpectrumColumns::Named(vec!["R (%)".into()])),
        ("nm,Transmission (anti-reflective, %)\n400,50\n410,25\n", SpectrumColumns::One),
        ("nm,R,G,B\n400,0.5,0.1,0.1\n410,0.25,0.1,0.1\n", SpectrumColumns::One),
    ] {
        let options = SpectrumOptions { columns: column, ..as_quantity(SpectrumQuantity::Transmittance) };
        let read = read_bytes("t.csv", text.as_bytes(), &options).unwrap();
        assert_eq!(read.curves[0].curve.values(), [0.5, 0.25]);
    }
    // Noise about 0 and 1 is no error, but told
    let (_, values, read_as) =
        one("t.csv", "nm,T\n400,1.01\n410,-0.002\n420,0.5\n", SpectrumQuantity::Fraction);
    assert_eq!(values, [1.0, 0.0, 0.5]);
    assert_eq!(
        read_as,
        "1 value below 0 taken as 0, as far as -2.00e-3; 1 value above 1 taken as 1, as far as 1.01e0"
    );
}

#[test]
fn a_wrong_line_within_a_table_is_told() {
    let good: String = (0..20).map(|i| format!("{},0.5\n", 400 + i)).collect();
    let bad = format!("nm,T\n{good}420,o.5\n421,0.5\n");
    let error = read_bytes("t.csv", bad.as_bytes(), &as_quantity(SpectrumQuantity::Fraction)).unwrap_err();
    assert!(error.starts_with("t.csv:22: column \"T\" holds \"o.5\", which is not a number"), "{error}");
    let first = format!("nm,T\n399,o.5\n{good}");
    let error = read_bytes("t.csv", first.as_bytes(), &as_quantity(SpectrumQuantity::Fraction)).unwrap_err();
    assert!(error.starts_with("t.csv:2: "), "{error}");
}

#[test]
fn a_table_between_blanks_does_not_end_where_a_value_is_missing() {
    let with = |bad: &str| -> String {
        (0..20).map(|i| format!("{} {}\n", 400 + i, if (8..12).contains(&i) { bad } else { "0.5" })).collect()
    };
    for (bad, said) in [
        ("NaN", "t.txt:10: column \"T\" has no value at 408 nm. Fill the cell, or remove the lines"),
        ("--", "t.txt:10: column \"T\" has no value at 408 nm"),
        ("*****", "t.txt:10: column \"T\" holds \"*****\", which is not a number"),
        (">6", "t.txt:10: column \"T\" holds \">6\", a bound. Write the bound as the value"),
        ("> 6", "t.txt:10: this line has 3 cells but the header has 2"),
    ] {
        let text = format!("wavelength T\n{}", with(bad));
        let error =
            read_bytes("t.txt", text.as_bytes(), &as_quantity(SpectrumQuantity::Fraction)).unwrap_err();
        assert!(error.starts_with(said), "{error}");
    }
}

#[test]
fn of_several_columns_that_which_was_measured_is_taken_or_none() {
    let light =
        |header: &str| one("t.csv", format!("{header}\n400,1,2\n410,1,4\n"), SpectrumQuantity::SpectralPower);
    let (_, values, read_as) = light("nm,Dark,Sample");
    assert_eq!(
        (values, read_as.as_str()),
        (vec![2.0, 4.0], "column \"Sample\" of Dark, Sample; \"Dark\" is not subtracted")
    );
    let (_, _, read_as) = one("t.csv", "nm,Dark counts\n400,1\n410,1\n", SpectrumQuantity::SpectralPower);
    assert!(read_as.starts_with("column \"Dark counts\" as the values: there is no other"), "{read_as}");
    let unnamed: String = (0..10).map(|i| format!("{},{},0.5\n", 200 + i, 400 + 5 * i)).collect();
    for (text, said) in [
        (
            "nm,%R,%T\n400,1,2\n410,1,4\n",
            "columns \"%R\" and \"%T\" are of different things. Name the one that is meant: { csv = \"t.csv\", column = \"%R\" } or column = \"%T\"",
        ),
        (
            "nm,exciter ex,emitter em,dichroic\n400,1,0,1\n410,1,0,1\n",
            "columns \"exciter ex\" and \"emitter em\" are of different things",
        ),
        (
            "nm,Dark,Reference,Sample\n400,9,99,50\n410,9,99,60\n",
            "what was measured: sample, dark and reference. Export",
        ),
        (&unnamed, "columns 1 and 2 may both be wavelengths. Put a line above"),
    ] {
        let error =
            read_bytes("t.csv", text.as_bytes(), &as_quantity(SpectrumQuantity::Fraction)).unwrap_err();
        assert!(error.contains(said), "{error}");
    }
    // Columns without names are called by their numbers
    let unnamed_values: String = (0..10).map(|i| format!("{},0.5,0.25\n", 400 + i)).collect();
    assert_eq!(
        one("t.csv", &unnamed_values, SpectrumQuantity::Fraction).2,
        "column 1 as wavelengths; column number 2 of 3"
    );
    let third =
        SpectrumOptions { columns: SpectrumColumns::Named(vec!["3".into()]), ..SpectrumOptions::default() };
    assert_eq!(
        read_bytes("t.csv", unnamed_values.as_bytes(), &third).unwrap().curves[0].curve.values()[0],
        0.25
    );
    // The line that is asked for
    let named = format!("pixel,wavelength_nm,T\n{unnamed}");
    assert_eq!(one("t.csv", named, SpectrumQuantity::Fraction).0[..2], [400.0, 405.0]);
}

/// What a spectrometer computes where its lamp has no light: some number of either sign, far beyond 0 to 1.
fn noise(place: usize) -> f64 {
    [13.0, -240.0, 95.5, 710.0, -4.0, -1850.0, 7.0][place % 7]
}

#[test]
fn ends_without_light_are_left_out() {
    let wanted: Vec<f64> = (30..170).map(|i| 0.1 + 0.004 * f64::from(i)).collect();
    let nm = |place: usize| 300.0 + place as f64;
    // The reference tells where there was light, and the ratio its unit, which no header names
    let mut jaz =
        String::from("Jaz Data File\nUser: jaz\n>>>>>Begin Processed Spectral Data<<<<<\nW\tD\tR\tS\tP\n");
    for place in 0..200 {
        let (dark, is_lit) = (900.0, (30..170).contains(&place));
        let (light, ratio) =
            if is_lit { (20_000.0, 0.1 + 0.004 * place as f64) } else { (1.0, 0.01 * noise(place)) };
        let computed = if place == 5 { "inf".into() } else { format!("{:.6}", 100.0 * ratio) };
        jaz += &format!("{}\t{dark}\t{}\t{:.6}\t{computed}\n", nm(place), dark + light, dark + ratio * light);
    }
    let (found_nm, found, read_as) = one("t.jaz", &jaz, SpectrumQuantity::Fraction);
    assert_eq!((found_nm[0], found_nm.len()), (330.0, 140));
    assert_near(&found, &wanted, "reference");
    assert!(
        read_as.contains("without 60 lines at the ends, where the reference has no light; percent"),
        "{read_as}"
    );
    // Without these columns the noise itself tells
    let value =
        |place: usize| if (30..170).contains(&place) { 10.0 + 0.4 * place as f64 } else { noise(place) };
    let bare: String = (0..200).map(|place| format!("{}\t{:.6}\n", nm(place), value(place))).collect();
    let (found_nm, found, read_as) = one("t.txt", &bare, SpectrumQuantity::Fraction);
    let first = found_nm.iter().position(|nm| *nm == 330.0).unwrap();
    assert_near(&found[first..first + 140], &wanted, "noise");
    assert!(found.len() <= 144 && read_as.contains("beyond lies noise"), "{read_as}");
    // A band that is too high is no noise
    let bump = |place: usize| 0.9 + 0.5 * (-((place as f64 - 120.0) / 10.0).powi(2)).exp();
    let smooth: String = (0..200).map(|place| format!("{}\t{:.6}\n", nm(place), bump(place))).collect();
    let error = read_bytes("t.txt", smooth.as_bytes(), &as_quantity(SpectrumQuantity::Fraction)).unwrap_err();
    assert!(error.contains("more than 1"), "{error}");
}

#[test]
fn noise_about_zero_becomes_zero_and_an_offset_does_not() {
    // The sine of a square is as good as random
    let text = |offset: f64| -> String {
        let value = |i: i32| if i < 150 { 1.0 } else { offset + 0.3 * (1.7 * f64::from(i * i)).sin() };
        (0..300).map(|i| format!("{}\t{:.5}\n", 400 + i, value(i))).collect()
    };
    let (_, values, read_as) = one("t.txt", text(0.0), SpectrumQuantity::SpectralPower);
    assert!(values.iter().all(|value| *value >= 0.0) && read_as.contains("below 0 taken as 0"), "{read_as}");
    let options = as_quantity(SpectrumQuantity::SpectralPower);
    let error = read_bytes("t.txt", text(-0.2).as_bytes(), &options).unwrap_err();
    assert!(error.contains("below zero"), "{error}");
}

#[test]
fn what_stands_twice_in_a_file_is_told() {
    // A curve read off a figure has two values where it is steep
    let rows: String = (0..20).map(|i| format!("{},{}\n", 400 + i, 0.01 * f64::from(i))).collect();
    let (nm, values, read_as) = one("t.csv", format!("nm,T\n{rows}410,0.9\n"), SpectrumQuantity::Fraction);
    assert_eq!((nm.len(), values[10]), (20, 0.5));
    assert!(read_as.contains("1 wavelength given twice: the mean of the values"), "{read_as}");
    // Two spectra, one below the other: the first
    let head = |unit: &str| format!("Irradiance [{unit}],\nName,a,\nGPS,,\n[nm],\n{rows}\n\n");
    let two = head("W/m2/nm") + &head("uE/m2/s/nm");
    let (nm, values, _) = one("t.csv", two, SpectrumQuantity::SpectralPower);
    assert_eq!((nm.len(), values[10]), (20, 0.1));
    // The first of three blocks is the processed one
    let block = |title: &str, y: f64| {
        format!(
            "##TITLE= {title}\n##XUNITS= NANOMETERS\n##YUNITS= Reflectance\n##XYPOINTS= (XY..XY)\n400, {y}\n410, {y}\n##END=\n"
        )
    };
    let link = block("EXPORTED: PROCESSED SPECTRUM", 0.5) + &block("EXPORTED: DARK SPECTRUM", 0.1);
    assert_eq!(one("t.jdx", link, SpectrumQuantity::Fraction).1, [0.5, 0.5]);
}

#[test]
fn samples_named_above_pairs_of_columns_are_told_apart() {
    let scans =
        "Wavelength (nm),%T,Wavelength (nm),%T,\n410,50,410,80,\n400,25,400,40,\n\nfilter\nScan rate 600\n";
    let read = |names: &str, columns: SpectrumColumns| {
        let options = SpectrumOptions { columns, ..as_quantity(SpectrumQuantity::Fraction) };
        let read = read_bytes("t.csv", format!("{names}\n{scans}").as_bytes(), &options).unwrap();
        (read.curves[0].curve.values().to_vec(), read.read_as.join("; "))
    };
    let named = |name: &str| SpectrumColumns::Named(vec![name.into()]);
    assert_eq!(read("long, 5 mm,,short, 5 mm,,", named("short, 5 mm")).0, [0.4, 0.8]);
    assert_eq!(read(",,short,,", named("short")).0, [0.4, 0.8]);
    assert_eq!(read("A,,short,", named("short")).0, [0.4, 0.8]);
    let (values, read_as) = read("Baseline 100%T,,short,,", SpectrumColumns::One);
    assert_eq!(values, [0.4, 0.8]);
    assert!(read_as.contains("column \"short (%T)\" of Baseline 100%T (%T), short (%T)"), "{read_as}");
}

/// Each of several pairs of columns ends by itself, whatever parts their cells.
#[test]
fn pairs_of_columns_may_be_of_any_lengths() {
    let table = "nm,R,nm,G,nm,B\n400,.02,400,.03,400,.04\n450,.1,450,.2,450,.3\n500,.1,500,.2,500,.3\n\
                 ,,550,.5,550,.6\n,,600,.1,,\n,,650,.2,,\n";
    for mark in [",", ";", "\t"] {
        let options = SpectrumOptions { quantity: SpectrumQuantity::Fraction, ..SpectrumOptions::default() };
        let read = read_bytes("t.txt", table.replace(',', mark).as_bytes(), &options).unwrap();
        let values: Vec<_> = read.curves.iter().map(|of| of.curve.values().to_vec()).collect();
        let wanted = [vec![0.02, 0.1, 0.1], vec![0.03, 0.2, 0.2, 0.5, 0.1, 0.2], vec![0.04, 0.3, 0.3, 0.6]];
        assert!(values == wanted && read.read_as.is_empty(), "{mark:?}: {values:?} {:?}", read.read_as);
        // Of one axis, a line without its wavelength is wrong
        let one_axis = "nm,R,G\n400,.1,.2\n450,.1,.2\n,,.2\n500,.1,.2\n".replace(',', mark);
        let error = read_bytes("t.txt", one_axis.as_bytes(), &options).unwrap_err();
        assert!(error.contains("t.txt:4: the wavelength is empty"), "{error}");
    }
}

#[test]
fn a_light_upon_its_dark_is_told() {
    let text = |dark: f64| -> String {
        let value = |i: i32| dark + 3200.0 * (-f64::from(i - 20).powi(2) / 9.0).exp();
        (0..40).map(|i| format!("{},{:.1}\n", 400 + 5 * i, value(i))).collect()
    };
    let read_as =
        |dark| one("t.csv", format!("nm,Counts\n{}", text(dark)), SpectrumQuantity::SpectralPower).2;
    assert!(
        read_as(800.0)
            .contains("never below 20 % of the largest value, and level there: is the dark subtracted?")
    );
    assert!(!read_as(10.0).contains("never below"));
}

#[test]
fn further_ways_of_writing_numbers_are_read() {
    let quoted = "WL(nm),T\n\"405,5\",\"2,5E-1\"\n404,\"5E-1\"\n";
    let (nm, values, _) = one("t.csv", quoted, SpectrumQuantity::Fraction);
    assert_eq!((nm, values), (vec![404.0, 405.5], vec![0.5, 0.25]));
    let padded =
        format!("instrument: A1{}\r\nWave ;T\r\n[nm] ;[%]\r\n400.0; 50\r\n401.0; 25\r\n", "\0".repeat(6));
    assert_eq!(one("t.ttt", padded, SpectrumQuantity::Fraction).1, [0.5, 0.25]);
    let (nm, _, read_as) = one("t.csv", "wavelength,T\n0.4,0.5\n0.5,0.25\n", SpectrumQuantity::Fraction);
    assert_near(&nm, &[400.0, 500.0], "micrometers");
    assert_eq!(read_as, "wavelengths in micrometers");
}

#[test]
fn binary_files_are_named() {
    let read = |bytes: &[u8]| read_bytes("t.spc", bytes, &SpectrumOptions::default()).unwrap_err();
    assert!(
        read(b"\x00\x04\x00\x00abc")
            .starts_with("t.spc: this is a binary file, not text. Export the spectra as text")
    );
    assert!(read(b"AVS84\x01u").contains("a binary file of AvaSoft"));
}

/// What is no wavelength is not taken for one, and a value with its unit in the cell is no text.
#[test]
fn times_shifts_and_cells_with_units_are_refused() {
    for (text, message) in [
        ("time_s,value\n200,1\n300,2\n400,3\n500,2\n", "the first column is \"time_s\", not a wavelength"),
        ("Raman shift (cm-1),v\n500,1\n600,2\n700,3\n800,2\n", "not a wavelength"),
        (
            "wavelength_nm,power,temperature\n400,0.9 W,20\n450,1.9 W,21\n500,0.4 W,22\n",
            "holds \"0.9 W\", which is not a number",
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        std::fs::write(&path, text).unwrap();
        let options =
            SpectrumOptions { quantity: SpectrumQuantity::SpectralPower, ..SpectrumOptions::default() };
        let said = read_spectra(&path, &options).map(|_| ()).unwrap_err().to_string();
        assert!(said.contains(message), "{said}");
    }
}

/// A light or its excitation in the name of a column is no second axis of wavelengths, whatever its values.
#[test]
fn wavelengths_of_lights_are_names() {
    let text = "Wavelength (nm),LED 405 nm,Intensity per nm\n380,201,1\n390,410,2\n400,1900,3\n410,1850,4\n420,520,5\n";
    let all = SpectrumOptions { quantity: SpectrumQuantity::SpectralPower, ..SpectrumOptions::default() };
    let read = read_bytes("leds.csv", text.as_bytes(), &all).unwrap();
    assert_eq!(read.curves.len(), 2);
    assert_eq!((read.curves[0].curve.peak_nm(), read.curves[1].curve.peak_nm()), (400.0, 420.0));
}

/// Units behind a comma, in a line of their own, or without brackets.
#[test]
fn units_stand_where_instruments_write_them() {
    use SpectrumQuantity::{Coefficient, Fraction, QuantumEfficiency};
    for (text, quantity, first) in [
        ("Wavelength, nm,Optical density, OD\n400,0.3\n500,1\n", Fraction, 0.501_187_233_6),
        ("Wavelength, nm,Absorbance\n400,0.3\n500,1\n", Fraction, 0.501_187_233_6),
        ("Optical density\nwavelength_nm,y\n400,0.3\n500,1\n", Fraction, 0.501_187_233_6),
        ("Wavelength, nm,Responsivity, A/W\n400,0.1\n500,0.2\n", QuantumEfficiency, 0.309_960_496),
        ("nm,Photosensitivity (A/W)\n400,0.1\n500,0.2\n", QuantumEfficiency, 0.309_960_496),
        ("nm,Relative sensitivity\n400,0.1\n500,0.2\n", QuantumEfficiency, 0.1),
        ("# unit: 1/cm\nwavelength_nm,mua\n400,2\n500,3\n", Coefficient, 0.2),
        ("wavelength_nm,absorption_per_cm\n400,2\n500,3\n", Coefficient, 0.2),
        ("Wavelength [A],mua\n4000,2\n5000,3\n", Coefficient, 2.0),
    ] {
        let (nm, values, _) = one("t.csv", text, quantity);
        assert_near(&nm, &[400.0, 500.0], text);
        assert!((values[0] / first - 1.0).abs() < 1e-9, "{text}: {values:?}");
    }
    for (text, quantity, word) in [
        ("nm,responsivity\n400,0.1\n500,0.2\n", QuantumEfficiency, "unit = \"a_per_w\""),
        ("nm,Photosensitivity\n400,0.1\n500,0.2\n", QuantumEfficiency, "unit = \"a_per_w\""),
        ("nm,Sensitivity\n400,0.1\n500,0.2\n", QuantumEfficiency, "unit = \"a_per_w\""),
        ("nm,Spectral_response\n400,0.1\n500,0.2\n", QuantumEfficiency, "unit = \"a_per_w\""),
        ("nm,A (%)\n400,10\n500,20\n", Fraction, "is of a"),
        ("nm,density\n400,0.1\n500,0.2\n", Fraction, "is of density"),
        ("nm,A\n400,0.1\n500,0.2\n", Fraction, "is of a"),
        ("nm,Rs (%),Ts (%)\n400,99,1\n500,50,50\n", Fraction, "are of different things"),
        ("Wavenumber (1/um),T\n2,0.1\n3,0.2\n", Fraction, "unit isn't known"),
        ("nm,epsilon_per_cm_per_M\n400,2\n500,3\n", Coefficient, "per_M"),
    ] {
        let error = read_bytes("t.csv", text.as_bytes(), &as_quantity(quantity)).unwrap_err();
        assert!(error.contains(word), "{text}: {error}");
    }
}

/// Errors of a column by any of their names go with it; channels are found by color.
#[test]
fn columns_are_known_by_the_words_of_their_names() {
    for name in ["tongue_sd", "tongue_err", "tongue_standard_error", "tongue uncertainty", "+/-", "SE"] {
        let text = format!("nm,tongue,{name}\n400,1,0.1\n500,2,0.2\n");
        let read = read_bytes("t.csv", text.as_bytes(), &SpectrumOptions::default()).unwrap();
        assert!(read.curves.len() == 1 && read.curves[0].standard_error.is_some(), "{name}");
    }
    let channels = ["R", "G", "B"].map(String::from).to_vec();
    let options = SpectrumOptions { columns: SpectrumColumns::Named(channels), ..SpectrumOptions::default() };
    for header in ["red,green,blue", "QE_R,QE_G,QE_B", "Red channel,Green channel,Blue channel"] {
        let text = format!("nm,{header}\n400,1,2,3\n500,1,2,3\n");
        let read = read_bytes("qe.csv", text.as_bytes(), &options).unwrap();
        assert_eq!(read.curves.iter().map(|c| c.curve.values()[0]).collect::<Vec<_>>(), [1.0, 2.0, 3.0]);
    }
    assert!(read_bytes("qe.csv", b"nm,R,Gr,Gb,B\n400,1,2,2,3\n", &options).is_err());
}

/// Wavelengths in another language stand before values whose unit names nanometers.
#[test]
fn values_per_nanometer_are_no_wavelengths() {
    for header in
        ["Longitud de onda;Irradiancia (mW m-2 nm-1)", "x;W m-2 nm-1", "\u{6ce2}\u{957f};E (mW/m2/nm)"]
    {
        let rows: String = (40..50).map(|tens| format!("{tens}0;{}\n", 300 + tens % 7)).collect();
        let (nm, _, _) = one("led.csv", format!("{header}\n{rows}"), SpectrumQuantity::SpectralPower);
        assert_eq!((nm[0], nm.len()), (400.0, 10), "{header}");
    }
}

#[test]
fn what_is_per_energy_or_absorbed_is_refused() {
    for (header, quantity, word) in [
        ("Photon energy (eV),Spectral irradiance (W/m2/eV)", SpectrumQuantity::SpectralPower, "of /ev"),
        ("Wavenumber (cm-1),W m-2 (cm-1)-1", SpectrumQuantity::SpectralPower, "of (cm-1)-1"),
        ("Wavelength (nm),Absorptance (%)", SpectrumQuantity::Fraction, "is of absorptance"),
        ("Wavelength (nm),1-R", SpectrumQuantity::Fraction, "is of 1-r"),
    ] {
        let rows =
            if header.contains("eV") { "2.0,1\n2.5,1\n3.0,1\n" } else { "16000,1\n20000,1\n24000,1\n" };
        let rows = if header.contains("nm") { "400,0.1\n500,0.2\n600,0.3\n" } else { rows };
        let refused = read_bytes("s.csv", format!("{header}\n{rows}").as_bytes(), &as_quantity(quantity));
        let refused = refused.expect_err(header);
        assert!(refused.contains(word), "{header}: {refused}");
    }
}

/// Names that begin as another quantity, and axes in the form of ISO 80000.
#[test]
fn names_of_filters_and_axes_are_no_quantities() {
    let fraction = SpectrumQuantity::Fraction;
    let (_, values, _) =
        one("f.csv", "Wavelength (nm),Absorption filter BG39 T (%)\n400,10\n500,20\n600,30\n", fraction);
    assert_near(&values, &[0.1, 0.2, 0.3], "filter");
    let (nm, _, _) = one("f.csv", "Energy/eV,T\n3,0.1\n2.5,0.2\n2,0.3\n", fraction);
    assert!((nm[0] - 1_239.841_984 / 3.0).abs() < 1e-6 && nm.len() == 3, "{nm:?}");
}

/// Commas between cells, decimals or thousands: what is not sure is asked.
#[test]
fn doubtful_commas_are_refused() {
    let power = SpectrumQuantity::SpectralPower;
    for (text, wanted) in [
        ("Wavelength,T\n400,0,50000\n405,0,60000\n", "t.csv:2: this line has 3 cells but the header has 2"),
        ("wavelength_nm,power\n400,17,1234.5\n405,18,1235.5\n", "t.csv:2: this line has 3 cells"),
        ("400,000000,0,500000\n405,000000,0,600000\n", "t.csv:1: the second column holds nothing but 0"),
        (
            "nm\tpower\n400\t987\n405\t\"1,052\"\n410\t\"1,100\"\n",
            "t.csv:3: 1,052 stands in a column with 987",
        ),
        // A baseline below one hundred, and a decimal point
        (
            "nm,power\n430,62\n440,\"1,850\"\n450,\"23,400\"\n460,\"2,100\"\n470,48\n",
            "t.csv:3: 1,850 stands in a column with 62",
        ),
        (
            "nm,power\n430,62.5\n440,\"1,850\"\n450,\"23,4\"\n460,\"2,1\"\n470,\"1,5\"\n",
            "t.csv:3: 1,850 stands in a column with 62.5",
        ),
    ] {
        let error = read_bytes("t.csv", text.as_bytes(), &as_quantity(power)).unwrap_err();
        assert!(error.starts_with(wanted), "{error}");
    }
    for text in [
        "nm\tpower\n400\t0,987\n405\t1,052\n410\t1,1\n",
        "nm;power\n400;100\n405;99,5\n410;101,25\n",
        // Wavelengths in steps of a third of ten
        "nm;power\n380;1,0\n383,333;1,1\n386,667;1,2\n390;1,3\n",
    ] {
        assert!(read_bytes("t.csv", text.as_bytes(), &as_quantity(power)).is_ok(), "{text}");
    }
    // A last column without a name
    let (_, values, _) = one("t.csv", "nm,power,\n400,1,7\n405,2,7\n", power);
    assert_near(&values, &[1.0, 2.0], "unnamed");
}

#[test]
fn relative_efficiencies_are_told() {
    let rows = "400,0.5\n500,1\n600,0.7\n";
    let read_as =
        |header: &str| one("qe.csv", format!("{header}\n{rows}"), SpectrumQuantity::QuantumEfficiency).2;
    for header in ["nm,R (relative)", "nm,relative_qe", "nm,normalized response"] {
        assert_eq!(read_as(header), "relative values, taken for electrons per photon");
    }
    assert_eq!(read_as("nm,R"), "");
}
