//! Volume files; the first byte chooses the ending.
#![no_main]

use lamina_volume_io::{Options, RawSpec, Series};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Some((kind, bytes)) = data.split_first() else { return };
    let endings = ["vti", "nrrd", "nhdr", "pvd", "raw", "raw.gz", "h5", "vtkhdf", "nc", "tif"];
    let ending = endings[usize::from(*kind) % endings.len()];
    let path = std::path::PathBuf::from(format!("/dev/shm/fuzzed-{}.{ending}", std::process::id()));
    std::fs::write(&path, bytes).expect("/dev/shm can be written");
    let raw = if ending.starts_with("raw") { RawSpec { dims: Some([4, 3, 2]), ..RawSpec::default() } } else { RawSpec::default() };
    if let Ok(series) = Series::open(&path, &Options { raw, ..Options::default() }) {
        let _ = series.read(0);
    }
    let _ = std::fs::remove_file(&path);
});
