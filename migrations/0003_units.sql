-- Units of work that a job's receipts stood for when the daemon last died under
-- it: a job that gets on, crash by crash, is no poison.
ALTER TABLE job ADD COLUMN units INTEGER NOT NULL DEFAULT 0;
