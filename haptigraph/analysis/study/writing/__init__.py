"""The methods section of a report, paragraph by paragraph."""
