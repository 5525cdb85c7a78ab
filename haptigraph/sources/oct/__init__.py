"""B-scans from OCT files, DICOM or a monitor."""
