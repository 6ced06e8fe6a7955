"""What a rig is by its data sheets: units as printed there, what follows from them, and a guess for the rest."""
