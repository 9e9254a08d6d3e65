//! Hostile names, links, foreign octrees, crashes and full disks.
