//! What arrives in a watched folder, and when a source may be deleted.
