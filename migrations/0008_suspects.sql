-- After a crash under several at once nobody knows who brought the daemon down: all
-- of them are suspects, run alone from then on, and are blamed only for what
-- happens while they do.
ALTER TABLE job ADD COLUMN suspect INTEGER NOT NULL DEFAULT 0;
-- The same of pictures; `drawing` while they are being drawn.
ALTER TABLE preview ADD COLUMN suspect INTEGER NOT NULL DEFAULT 0;
ALTER TABLE preview ADD COLUMN drawing INTEGER NOT NULL DEFAULT 0;
