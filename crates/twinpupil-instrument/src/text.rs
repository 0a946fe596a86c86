//! Text files of other programs, in whatever encoding they come.

use crate::check::SyntaxError;

/// The text of a file in UTF-8, UTF-16 (either order) or else Latin-1.
pub fn decode(bytes: &[u8]) -> Result<String, SyntaxError> {
    let text = match bytes {
        [0xef, 0xbb, 0xbf, rest @ ..] => narrow(rest),
        [0xff, 0xfe, rest @ ..] => wide(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => wide(rest, u16::from_be_bytes),
        // Without a mark, text that starts with a Latin letter tells by where its zeros are.
        [first, 0, ..] if *first != 0 => wide(bytes, u16::from_le_bytes),
        [0, second, ..] if *second != 0 => wide(bytes, u16::from_be_bytes),
        _ => narrow(bytes),
    };
    match text.find(|c: char| c.is_control() && !c.is_whitespace() && c != '\u{1a}') {
        None => Ok(text),
        Some(at) => {
            let line = 1 + text[..at].matches('\n').count();
            Err(SyntaxError { line, message: "there is a control character, so this is not a text file".to_owned() })
        }
    }
}

fn narrow(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|byte| latin(*byte)).collect(),
    }
}

/// Latin-1, where vendors' files on Windows have quotes and dashes among the control characters.
fn latin(byte: u8) -> char {
    if (0x80..0xa0).contains(&byte) { char::REPLACEMENT_CHARACTER } else { char::from(byte) }
}

fn wide(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> String {
    let (pairs, _) = bytes.as_chunks::<2>();
    char::decode_utf16(pairs.iter().map(|pair| unit(*pair))).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_text_in_every_encoding() {
        let text = "NAME Ø 25 mm\nSURF 0\n";
        let units: Vec<u16> = text.encode_utf16().collect();
        let little: Vec<u8> = units.iter().flat_map(|unit| unit.to_le_bytes()).collect();
        let big: Vec<u8> = units.iter().flat_map(|unit| unit.to_be_bytes()).collect();
        let with = |mark: &[u8], bytes: &[u8]| [mark, bytes].concat();
        for bytes in [
            text.as_bytes().to_vec(),
            with(&[0xef, 0xbb, 0xbf], text.as_bytes()),
            little.clone(),
            with(&[0xff, 0xfe], &little),
            big.clone(),
            with(&[0xfe, 0xff], &big),
            text.chars().map(|c| c as u8).collect(),
        ] {
            assert_eq!(decode(&bytes).as_deref(), Ok(text), "{bytes:?}");
        }
    }

    #[test]
    fn what_is_no_text_is_refused_with_its_line() {
        let error = decode(b"NM A\nNM B\x00\x01\n").unwrap_err();
        assert_eq!(
            (error.line, error.message.as_str()),
            (2, "there is a control character, so this is not a text file")
        );
        assert_eq!(decode(b"").as_deref(), Ok(""));
    }
}
