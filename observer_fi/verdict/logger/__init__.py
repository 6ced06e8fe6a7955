"""A rig and its bank fitted to what a log shows of its logger: noise, delays, and filters before its readings."""
