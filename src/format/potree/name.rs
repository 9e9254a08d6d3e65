//! Names of nodes: `r`, then one digit 0-7 a level, x in bit 2, y in bit 1,
//! z in bit 0. A name is a level and the digits as one octal number, so that
//! sorting by (level, digits) is the breadth-first order of the hierarchy.

use std::fmt;
use std::str::FromStr;

/// A node's place in the octree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeName {
    level: u8,
    /// The digits, the first one highest.
    digits: u128,
}

impl NodeName {
    pub const ROOT: NodeName = NodeName { level: 0, digits: 0 };
    /// Deepest level a name can have: 42 octal digits fill 126 bits. A lattice
    /// of 32 bits needs at most 32.
    pub const MAX_LEVEL: u8 = 42;

    /// A name of its digits, each 0 to 7, the root's child first.
    pub fn from_digits(digits: &[u8]) -> Option<NodeName> {
        digits.iter().try_fold(NodeName::ROOT, |name, &digit| name.child(digit))
    }

    /// The node at cell (x, y, z) of the 2^level grid.
    pub fn from_cell(level: u8, [x, y, z]: [u64; 3]) -> Option<NodeName> {
        (0..level).rev().try_fold(NodeName::ROOT, |name, bit| {
            let digit = ((x >> bit & 1) << 2) | ((y >> bit & 1) << 1) | (z >> bit & 1);
            name.child(digit as u8)
        })
    }

    /// The cell of the 2^level grid that this node fills.
    pub fn cell(self) -> [u64; 3] {
        self.iter().fold([0; 3], |[x, y, z], digit| {
            let digit = u64::from(digit);
            [(x << 1) | (digit >> 2), (y << 1) | (digit >> 1 & 1), (z << 1) | (digit & 1)]
        })
    }

    /// `None` where the digit is no child's or the name would be too long.
    pub fn child(self, digit: u8) -> Option<NodeName> {
        if digit > 7 || self.level >= NodeName::MAX_LEVEL {
            return None;
        }
        Some(NodeName { level: self.level + 1, digits: (self.digits << 3) | u128::from(digit) })
    }

    pub fn parent(self) -> Option<NodeName> {
        Some(NodeName { level: self.level.checked_sub(1)?, digits: self.digits >> 3 })
    }

    /// The ancestor at a level above this one, or the node itself.
    pub fn ancestor(self, level: u8) -> Option<NodeName> {
        let up = self.level.checked_sub(level)?;
        Some(NodeName { level, digits: self.digits >> (3 * u32::from(up)) })
    }

    pub fn level(self) -> u8 {
        self.level
    }

    /// Which child of its parent this node is; 0 for the root.
    pub fn digit(self) -> u8 {
        (self.digits & 7) as u8
    }

    /// The digits from the root's child on.
    pub fn iter(self) -> impl Iterator<Item = u8> {
        (0..self.level).rev().map(move |level| (self.digits >> (3 * u32::from(level)) & 7) as u8)
    }
}

impl fmt::Display for NodeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = String::with_capacity(1 + usize::from(self.level));
        text.push('r');
        text.extend(self.iter().map(|digit| char::from(b'0' + digit)));
        f.pad(&text)
    }
}

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is no node: a name is r and at most 42 digits 0 to 7, such as r024")]
pub struct NotAName(String);

impl FromStr for NodeName {
    type Err = NotAName;

    fn from_str(text: &str) -> Result<NodeName, NotAName> {
        let digits = text.strip_prefix('r').map(|rest| rest.bytes().map(|b| b.wrapping_sub(b'0')).collect());
        digits.and_then(|d: Vec<u8>| NodeName::from_digits(&d)).ok_or_else(|| NotAName(text.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn digits_are_x_y_z_from_the_high_bit() {
        let name: NodeName = "r41".parse().unwrap();
        assert_eq!(name.cell(), [2, 0, 1]);
        assert_eq!(name.parent().unwrap().to_string(), "r4");
        assert_eq!(name.ancestor(0), Some(NodeName::ROOT));
    }

    #[test]
    fn what_is_no_name_is_refused() {
        for text in ["", "r8", "x", "r0 ", "0", &format!("r{}", "0".repeat(43))] {
            assert!(text.parse::<NodeName>().is_err(), "{text}");
        }
    }

    proptest! {
        #[test]
        fn names_come_back_from_text_and_cell(digits in proptest::collection::vec(0u8..8, 0..=42)) {
            let name = NodeName::from_digits(&digits).unwrap();
            prop_assert_eq!(name.to_string().parse::<NodeName>().unwrap(), name);
            prop_assert_eq!(NodeName::from_cell(name.level(), name.cell()), Some(name));
            prop_assert_eq!(name.iter().collect::<Vec<_>>(), digits);
        }
    }
}
