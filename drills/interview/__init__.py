"""Commands that rehearse an interview; each module is imported when its command is used."""
