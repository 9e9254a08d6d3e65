//! Text in fields of a fixed length, as headers and records have it.

/// A field of text: up to its first zero, without blanks around it, and with
/// what is not UTF-8 replaced.
pub fn get(field: &[u8]) -> String {
    let end = field.iter().position(|byte| *byte == 0).unwrap_or(field.len());
    String::from_utf8_lossy(&field[..end]).trim().to_string()
}

/// As much of `text` as fits, cut between characters, the rest zero.
pub fn put(field: &mut [u8], text: &str) {
    let mut end = text.len().min(field.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    field[..end].copy_from_slice(&text.as_bytes()[..end]);
}
