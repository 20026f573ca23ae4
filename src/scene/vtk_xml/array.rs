//! Decodes the arrays of VTK's XML files.

use std::io::Read;

use data_encoding::BASE64;

use crate::memory;
use crate::scene::number::Number;

/// Most bytes that LZ4 makes of one byte.
const MOST_BY_LZ4: usize = 256;

/// The type of numbers of this name.
pub fn number_named(name: &str) -> Option<Number> {
    let whole = |bytes, signed| Some(Number::Whole { bytes, signed });
    match name {
        "Int8" => whole(1, true),
        "UInt8" => whole(1, false),
        "Int16" => whole(2, true),
        "UInt16" => whole(2, false),
        "Int32" => whole(4, true),
        "UInt32" => whole(4, false),
        "Int64" => whole(8, true),
        "UInt64" => whole(8, false),
        "Float32" => Some(Number::Float),
        "Float64" => Some(Number::Double),
        _ => None,
    }
}

/// The bytes in which arrays are.
pub enum Appended<'a> {
    /// As text of four characters for three bytes.
    Base64(&'a [u8]),
    /// As they are.
    Raw(&'a [u8]),
}

impl<'a> Appended<'a> {
    /// The data at the end of a file, in the encoding of this name.
    pub fn new(encoding: &str, data: &'a [u8]) -> Result<Appended<'a>, String> {
        match encoding {
            "raw" => Ok(Appended::Raw(data)),
            "base64" => Ok(Appended::Base64(data)),
            other => Err(format!("appended data of the unknown encoding \"{}\"", other.escape_debug())),
        }
    }

    /// The `count` bytes that were encoded together at `at`, and the place after them.
    fn take(&self, at: usize, count: usize) -> Result<(Vec<u8>, usize), String> {
        let short = || "ends early".to_string();
        let (data, length) = match self {
            Appended::Raw(data) => (data, count),
            Appended::Base64(data) => (data, count.div_ceil(3).checked_mul(4).ok_or_else(short)?),
        };
        let end = at.checked_add(length).ok_or_else(short)?;
        let taken = data.get(at..end).ok_or_else(short)?;
        let bytes = match self {
            Appended::Raw(_) => taken.to_vec(),
            Appended::Base64(_) => BASE64.decode(taken).map_err(|error| format!("is no valid base64: {error}"))?,
        };
        Ok((bytes, end))
    }
}

/// How the numbers of a file are encoded.
#[derive(Debug, Clone, Copy, Default)]
pub struct Encoding {
    is_big: bool,
    /// Bytes of the numbers in the header of an array.
    header: usize,
    compression: Option<Compression>,
}

/// The ways in which VTK compresses blocks.
#[derive(Debug, Clone, Copy)]
enum Compression {
    Zlib,
    Lz4,
}

impl Compression {
    /// The `wanted` bytes of a compressed block, and possibly one more where it has more.
    fn inflate(self, block: &[u8], wanted: usize) -> Result<Vec<u8>, String> {
        let failed = |error: &dyn std::fmt::Display| format!("cannot be decompressed: {error}");
        match self {
            Compression::Zlib => {
                let (mut bytes, most) = (Vec::new(), (wanted as u64).saturating_add(1));
                let inflated = flate2::read::ZlibDecoder::new(block).take(most).read_to_end(&mut bytes);
                inflated.map(|_| bytes).map_err(|error| failed(&error))
            }
            Compression::Lz4 if wanted > MOST_BY_LZ4 * (block.len() + 1) => {
                Err(format!("has a block of {wanted} bytes in {} compressed ones", block.len()))
            }
            Compression::Lz4 => lz4_flex::block::decompress(block, wanted).map_err(|error| failed(&error)),
        }
    }
}

impl Encoding {
    /// The encoding that the attributes of a file's root tell.
    pub fn of<'a>(attribute: impl Fn(&str) -> Option<&'a str>) -> Result<Encoding, String> {
        let is_big = match attribute("byte_order").unwrap_or("LittleEndian") {
            "LittleEndian" => false,
            "BigEndian" => true,
            other => return Err(format!("unknown byte order \"{}\"", other.escape_debug())),
        };
        let header = match attribute("header_type").unwrap_or("UInt32") {
            "UInt32" => 4,
            "UInt64" => 8,
            other => return Err(format!("headers of the unknown type \"{}\"", other.escape_debug())),
        };
        let compression = match attribute("compressor").unwrap_or_default() {
            "" => None,
            "vtkZLibDataCompressor" => Some(Compression::Zlib),
            "vtkLZ4DataCompressor" => Some(Compression::Lz4),
            other => return Err(format!("compressed by \"{}\", which is not read", other.escape_debug())),
        };
        Ok(Encoding { is_big, header, compression })
    }

    /// The numbers of the array that begins at `at`. An error says what the array does wrong.
    pub fn numbers(&self, kind: Number, data: &Appended, at: usize) -> Result<Vec<f64>, String> {
        let mut bytes = match self.compression {
            Some(compression) => self.inflate(compression, data, at)?,
            None => self.plain(data, at)?,
        };
        let size = kind.bytes();
        if bytes.len() % size > 0 {
            return Err(format!("has {} bytes, which are no whole numbers of {size} bytes", bytes.len()));
        }
        if self.is_big {
            bytes.chunks_mut(size).for_each(<[u8]>::reverse);
        }
        Ok(bytes.chunks(size).map(|number| kind.of(number)).collect())
    }

    /// Numbers of a header.
    fn counts(&self, bytes: &[u8]) -> Result<Vec<usize>, String> {
        let count = |bytes: &[u8]| {
            let fold = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
            let number = if self.is_big { bytes.iter().fold(0, fold) } else { bytes.iter().rev().fold(0, fold) };
            usize::try_from(number).map_err(|_| "is too long".to_string())
        };
        bytes.chunks_exact(self.header).map(count).collect()
    }

    /// The bytes of an array that is not compressed: their number, then they themselves.
    fn plain(&self, data: &Appended, at: usize) -> Result<Vec<u8>, String> {
        let (head, end) = data.take(at, self.header)?;
        let count = self.counts(&head)?.first().copied().unwrap_or_default();
        // Most writers encode header and data together, some one after the other.
        if head.len() == self.header {
            return Ok(data.take(end, count)?.0);
        }
        let all = count.checked_add(self.header).ok_or("is too long")?;
        Ok(data.take(at, all)?.0.split_off(self.header))
    }

    /// The bytes of a compressed array: the number of blocks, the size of a block and of the last one, if that is not
    /// whole, and the compressed size of each; then the blocks.
    fn inflate(&self, compression: Compression, data: &Appended, at: usize) -> Result<Vec<u8>, String> {
        let begin = self.counts(&data.take(at, 3 * self.header)?.0)?;
        let [blocks, size, last] = begin[..] else { return Err("ends early".into()) };
        let head = blocks.checked_add(3).and_then(|count| count.checked_mul(self.header)).ok_or("is too long")?;
        let (head, begin) = data.take(at, head)?;
        let sizes = self.counts(&head)?.split_off(3);
        let sum = sizes.iter().try_fold(0_usize, |sum, size| sum.checked_add(*size)).ok_or("is too long")?;
        let (packed, _) = data.take(begin, sum)?;
        memory::ask(memory::BYTES_PER_BYTE_OF_MESH * blocks as f64 * size as f64)?;
        let (mut bytes, mut rest) = (Vec::new(), &packed[..]);
        for (k, &count) in sizes.iter().enumerate() {
            let (block, behind) = rest.split_at_checked(count).ok_or("ends early")?;
            rest = behind;
            let wanted = if k + 1 == blocks && last > 0 { last } else { size };
            let inflated = compression.inflate(block, wanted)?;
            if inflated.len() != wanted {
                return Err(format!("has a block that is not of {wanted} bytes, as its header says"));
            }
            bytes.extend(inflated);
        }
        Ok(bytes)
    }
}

/// Whether elements are nested more deeply than in any file of VTK; the parser of XML needs stack for each level.
pub fn is_deep(text: &[u8]) -> bool {
    const MOST: usize = 100;
    let (mut depth, mut at) = (0_usize, 0);
    while let Some(tag) = text[at..].iter().position(|byte| *byte == b'<').map(|place| at + place + 1) {
        match text.get(tag) {
            Some(b'/') => depth = depth.saturating_sub(1),
            Some(b'?' | b'!') => {}
            _ => {
                // An element without content ends in its own tag.
                let end = text[tag..].iter().position(|byte| *byte == b'>').map_or(text.len(), |place| tag + place);
                depth += usize::from(!text[..end].ends_with(b"/"));
            }
        }
        if depth > MOST {
            return true;
        }
        at = tag;
    }
    false
}

/// Divides a file into its XML and the appended data, which may be no text; the XML ends with the opening tag of the
/// element that has the data.
pub fn split(bytes: &[u8]) -> (&[u8], Option<&[u8]>) {
    const TAG: &[u8] = b"<AppendedData";
    let Some(tag) = bytes.windows(TAG.len()).position(|window| window == TAG) else { return (bytes, None) };
    let Some(end) = bytes[tag..].iter().position(|byte| *byte == b'>').map(|end| tag + end + 1) else {
        return (bytes, None);
    };
    match bytes[end..].iter().position(|byte| *byte == b'_') {
        Some(mark) => (&bytes[..end], Some(&bytes[end + mark + 1..])),
        None => (bytes, None),
    }
}
