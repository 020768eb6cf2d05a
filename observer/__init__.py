"""One judge: camera -> tracks -> Vector Symbols -> belief -> posterior; and how it learns its perspective."""
