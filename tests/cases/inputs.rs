//! Counts, chunk tables, what lies behind the points, and inputs that claim too much.
