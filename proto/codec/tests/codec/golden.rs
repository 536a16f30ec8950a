//! Bytes that earlier versions wrote, kept to the byte.

use super::*;

#[test]
fn golden_bytes_of_version_1() {
    let piece = |start, end, optical_depth| Supersegment { start, end, color: [1.0, 0.2, 0.0], optical_depth };
    let original =
        vdi(2, vec![vec![piece(3, 5, 0.1), piece(9, 400, f32::INFINITY)], vec![], vec![piece(2, 3, 1.0)], vec![]]);
    let bytes =
        encode(&original, &EncodeOptions { codec: Codec::Zstd, layout: Layout::Columns, ..EncodeOptions::BZIP2 })
            .unwrap();
    let hex = |b: &[u8]| b.iter().map(|b| format!("{b:02x}")).collect::<String>();
    let header = concat!(
        "4c5644490100c200",
        "000000000000f03f00000000000000400000000000002240",
        "000000000000000000000000000000000000000000000000",
        "0000000000000000000000000000f03f0000000000000000",
        "0000000000804140",
        "00000000000000c000000000000000c000000000000000c0",
        "000000000000004000000000000000400000000000000040",
        "b81e85eb51b89e3f",
        "02000000",
        "7b14ae47e17a943f",
        "000000000000f03f",
        "000000000000e03f",
        "efcdab8967452301",
        "000000000000003f0000803f",
        "01",
        "00",
        "03000000",
        "02000000",
    );
    assert_eq!(hex(&bytes[..TABLE_AT]), header);
    // Every block this small is stored by zstd as it is: magic, descriptor, size, 3 bytes of block header, then the data.
    // Counts 2, 0, 1, 0 differ by 2, -2, 1, -1; first starts 3, 2; one gap of 4; one length of 391 = 256 + 134 + 1.
    // At gamma = 0.02 opacity has the codes k 255 / 50: of the depths 0.1 and 1, k = 11 and 31. Colors have codes k 255 / 15 in the
    // first supersegment, k 255 / 127 in the opaque one and k 255 / 63 in the last: 0.2 is 51, 50 and 53.
    let stored =
        |raw: &[u8]| [&[0x28, 0xb5, 0x2f, 0xfd, 0x20, raw.len() as u8, 8 * raw.len() as u8 + 1, 0, 0], raw].concat();
    let raw: [&[u8]; 5] =
        [&[4, 3, 2, 1], &[6, 1], &[4], &[0, 1, 0], &[255, 51, 0, 56, 1, 255, 50, 0, 255, 134, 255, 53, 0, 158, 0]];
    let table: Vec<u8> = raw.iter().zip([1, 1, 1, 1, 5]).flat_map(|(r, w)| [w, 9 + r.len() as u8, 0, 0, 0]).collect();
    let expected = [table, raw.map(stored).concat()].concat();
    assert_eq!(hex(&bytes[TABLE_AT..bytes.len() - 4]), hex(&expected));
    assert_eq!(bytes, with_crc(bytes.clone()));
}

/// Version 3 is frozen, too; `read_vdi.py` reads these bytes as the lists below.
#[test]
fn golden_bytes_of_version_3() {
    let piece = |start, end, optical_depth| Supersegment { start, end, color: [1.0, 0.2, 0.0], optical_depth };
    let list = |k: u32| (0..k % 4).map(|n| piece(20 * n + k, 20 * n + 3 * k + 1, 0.1 * (n + k) as f32)).collect();
    let original = vdi(3, (0..9).map(|k| list(k / 2)).collect());
    let bytes = encode(
        &original,
        &EncodeOptions { codec: Codec::ContextMixing, layout: Layout::Columns, ..EncodeOptions::BZIP2 },
    )
    .unwrap();
    let hex = bytes[TABLE_AT..bytes.len() - 4].iter().map(|b| format!("{b:02x}")).collect::<String>();
    let golden = "0f0000000000000011000000000000000200000000000000d138b8f00b8f85ebd496201746ee7f979822ba120bd2053ac30d6a4387b63b9ebafe";
    assert_eq!(hex, golden);
    assert_eq!(decode(&bytes, &DecodeLimits::default()).unwrap(), quantize(&original));
}

/// The same of so many supersegments that all tables have their greatest size, and of several bands: their checksum.
#[test]
fn golden_checksum_of_a_large_vdi_of_version_3() {
    let resolution = 600;
    let piece = |ray: u32, k: u32| {
        let (x, y) = (ray % resolution / 7, ray / resolution / 5);
        let start = 40 * k + (x + y) % 9;
        let color = [(x % 5) as f32 / 4.0, (y % 3) as f32 / 2.0, 0.5];
        Supersegment { start, end: start + 1 + (x * y + k) % 30, color, optical_depth: 0.05 * ((x + k) % 11) as f32 }
    };
    let list = |ray: u32| (0..(ray / 11 + ray / resolution) % 6).map(|k| piece(ray, k)).collect();
    let original = vdi(resolution, (0..resolution * resolution).map(list).collect());
    let bytes = encode(&original, &EncodeOptions::default()).unwrap();
    assert_eq!(decode(&bytes, &DecodeLimits::default()).unwrap(), quantize(&original));
    assert!(original.segments().len() > 6 * 131_072);
    assert_eq!((bytes.len(), crc32fast::hash(&bytes)), (181_411, 558_161_692));
}
