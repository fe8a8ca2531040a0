"""The local server of the page: who may ask, what tabs say, and the pace of their flights."""
