"""Other programs that open what is exported, each as its users would; all give linear views."""
