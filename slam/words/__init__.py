"""Visual words: vocabulary, inverted index, likelihood and the Bayes filter over places. Begin with
`place_recognition.py`."""
